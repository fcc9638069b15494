/** Head of a curve: what it is, its latest value with age, its setpoint. */

import { splitReading } from "@/model/format";
import { readable, type Channel } from "@/model/telemetry";
import { useMemo } from "react";
import { Figure, ReadingValue } from "./number";
import { Plot } from "./plot";
import { Age } from "./time";

export function ChannelPlot(props: {
  channel: Channel;
  from_s?: number;
  to_s?: number;
  height?: number;
}) {
  const channel = useMemo(() => readable(props.channel), [props.channel]);
  const last = channel.points.at(-1);
  const set = channel.setpoints.at(-1);
  return (
    <figure className="plot" data-testid={`plot-${channel.status}`}>
      <figcaption>
        <b className="b cut">{channel.label}</b>
        <i className="sp" />
        <span className="key">
          <Stroke />
          <b>
            {last ? (
              <ReadingValue value={last[1]} unit={channel.unit} />
            ) : (
              <Figure value="–" unit={channel.unit} />
            )}
          </b>
        </span>
        {set && (
          <span className="key s">
            <Stroke isDashed />
            set <span className="num">{splitReading(set[1], channel.unit)[0]}</span>
          </span>
        )}
        <span className="m">{last && <Age at_s={last[0]} />}</span>
      </figcaption>
      <Plot
        channel={channel}
        height={props.height ?? 112}
        {...(props.from_s === undefined ? {} : { from_s: props.from_s })}
        {...(props.to_s === undefined ? {} : { to_s: props.to_s })}
      />
    </figure>
  );
}

function Stroke({ isDashed = false }: { isDashed?: boolean }) {
  return (
    <svg width="16" height="8" aria-hidden="true">
      <path
        d="M0 4H16"
        stroke="var(--p1)"
        strokeWidth={isDashed ? 1.25 : 1.75}
        strokeDasharray={isDashed ? "4 3" : undefined}
      />
    </svg>
  );
}
