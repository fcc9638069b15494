/** The timeline: what each device did, does, and is expected to do. */

import { useState } from "react";
import { formatDuration } from "@/model/format";
import { layoutGantt, share, ticks, type Bar, type Gantt } from "@/model/gantt";
import { jobState } from "@/model/states";
import type { Run } from "@/model/wire";
import { Card } from "@/ui/card";
import { Hint, Segments } from "@/ui/controls";
import { Icon, iconOf } from "@/ui/icons";
import { useLabTime, useNow } from "@/ui/time";

const BY = [
  { value: "devices", label: "Devices" },
  { value: "steps", label: "Steps" },
] as const;
/** Shares of the width below which a bar has no room for its sentence, or its number. */
const SENTENCE = 0.09;
const FIGURE = 0.024;

interface TimelineProps {
  run: Run;
  picked: string | null;
  onPick: (jobId: string) => void;
}

export function Timeline({ run, picked, onPick }: TimelineProps) {
  const [by, setBy] = useState<"devices" | "steps">("devices");
  const now = useNow(1000);
  const time = useLabTime();
  const gantt = layoutGantt(run, now, by);
  const span = gantt.to_s - gantt.from_s;
  const label = span < 600 ? time.second.bind(time) : time.minute.bind(time);
  const marks = ticks(gantt);
  const percent = (at: number): string => `${(share(gantt, at) * 100).toFixed(3)}%`;
  return (
    <Card
      title="Timeline"
      testId="timeline"
      actions={<span className="t12 num">{formatDuration(span)}</span>}
      note={<Segments label="Rows" value={by} options={BY} onChange={setBy} className="wide" />}
    >
      <div className="gantt">
        <div className="gx num">
          {labelled(gantt, marks).map((at) => (
            <i key={at} style={{ left: percent(at) }}>
              {label(at)}
            </i>
          ))}
        </div>
        {gantt.rows.map((row) => (
          <div className="gr" key={row.id} data-row={row.id}>
            <span className="gl" title={row.name}>
              {by === "devices" && <Icon name={iconOf(row.name)} />}
              <span className="cut">{row.name}</span>
            </span>
            <span className="gp">
              {row.bars.map((bar) => (
                <BarMark
                  key={bar.job.id}
                  bar={bar}
                  gantt={gantt}
                  isPicked={picked === bar.job.id}
                  onPick={onPick}
                />
              ))}
            </span>
          </div>
        ))}
        <div className="gg" aria-hidden="true">
          {marks.map((at) => (
            <i key={at} style={{ left: percent(at) }} />
          ))}
          {gantt.now_s !== null && (
            <i className="now" style={{ left: percent(gantt.now_s) }}>
              <b className="num">{time.minute(gantt.now_s)}</b>
            </i>
          )}
        </div>
      </div>
    </Card>
  );
}

/** A label that would leave the plot, or lie under the present, is not written; its line stays. */
function labelled(gantt: Gantt, marks: number[]): number[] {
  const present = gantt.now_s === null ? null : share(gantt, gantt.now_s);
  return marks.filter((at) => {
    const place = share(gantt, at);
    const isInside = place >= 0.045 && place <= 0.955;
    return isInside && (present === null || Math.abs(place - present) > 0.07);
  });
}

function BarMark(props: {
  bar: Bar;
  gantt: Gantt;
  isPicked: boolean;
  onPick: (jobId: string) => void;
}) {
  const { bar, gantt } = props;
  const left = share(gantt, bar.start_s);
  const width = share(gantt, bar.end_s) - left;
  const took = formatDuration(bar.end_s - bar.start_s);
  const state = jobState(bar.job.state);
  const word = bar.look === "away" ? `${state.word} when last heard` : state.word;
  const title = `${bar.label} ${bar.job.sentence} · ${word}, ${took}`;
  return (
    <Hint text={title}>
      <button
        type="button"
        className={`bar ${bar.look} ${props.isPicked ? "picked" : ""}`}
        style={{ left: `${left * 100}%`, width: `${width * 100}%` }}
        aria-label={title}
        data-job={bar.job.id}
        data-testid={`job-${bar.job.index}`}
        data-state={bar.job.state}
        onClick={() => props.onPick(bar.job.id)}
      >
        {width > FIGURE && (
          <span>{width > SENTENCE ? `${bar.label} ${bar.job.sentence}` : bar.label}</span>
        )}
      </button>
    </Hint>
  );
}
