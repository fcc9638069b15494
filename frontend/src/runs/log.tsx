/** What the hosts reported, oldest first; the end is followed until one scrolls away. */

import { useEffect, useMemo, useRef, useState } from "react";
import { useRunLog } from "@/api/queries";
import { lineWords } from "@/model/format";
import { capitalise } from "@/model/states";
import type { LogLine } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { At } from "@/ui/time";
import { words } from "./words";

export function RunLog({ runId, job }: { runId: string; job: string | null }) {
  const log = useRunLog(runId);
  const [text, setText] = useState("");
  return (
    <Card
      title={words.tabs.logs}
      note={job ? "one action" : null}
      actions={
        <input
          className="inp filter"
          aria-label="Filter lines"
          placeholder="Filter lines"
          value={text}
          onChange={(event) => setText(event.target.value)}
        />
      }
    >
      <Loaded source={log} what="the log">
        {(lines) => <Lines lines={lines} text={text} job={job} />}
      </Loaded>
    </Card>
  );
}

function Lines({ lines, text, job }: { lines: LogLine[]; text: string; job: string | null }) {
  const box = useRef<HTMLDivElement>(null);
  const follows = useRef(true);
  const wanted = text.trim().toLowerCase();
  const shown = useMemo(
    () =>
      lines.filter(
        (line) =>
          (!job || line.job_id === job) &&
          `${line.kind} ${line.text}`.toLowerCase().includes(wanted),
      ),
    [lines, job, wanted],
  );
  useEffect(() => {
    const node = box.current;
    if (node && follows.current) node.scrollTop = node.scrollHeight;
  }, [shown]);
  if (!shown.length) return <Empty>{lines.length ? "No line fits." : words.noLog}</Empty>;
  return (
    <div
      className="loglines"
      ref={box}
      tabIndex={0}
      role="log"
      onScroll={(event) => {
        const node = event.currentTarget;
        follows.current = node.scrollHeight - node.scrollTop - node.clientHeight < 24;
      }}
    >
      <table>
        <tbody>
          {shown.map((line, place) => (
            <tr key={place} data-testid="log-line">
              <td className="num m t12">
                <At at={line.at} seconds />
              </td>
              <td className="num m t12 r">{line.job_index === null ? "" : line.job_index + 1}</td>
              <td className="t12 s">{capitalise(line.kind)}</td>
              <td className="mono">{lineWords(line.text)}</td>
              <td className="r">
                <Body body={line.body} />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Body({ body }: { body: unknown }) {
  if (!body || (typeof body === "object" && Object.keys(body).length === 0)) return null;
  return (
    <details className="logbody">
      <summary className="t12 m">details</summary>
      <pre className="mono">{JSON.stringify(body, null, 2)}</pre>
    </details>
  );
}
