/** Runs as rows; the same on Home and on the page of runs. */

import { Link } from "react-router";
import { runOutcome } from "@/model/decisions";
import { formatDuration, sentence } from "@/model/format";
import type { RunRow } from "@/model/wire";
import { Progress } from "./number";
import { ModeChip, StateChip } from "./state";
import { At } from "./time";

export function RunTable({ runs, isHistory = false }: { runs: RunRow[]; isHistory?: boolean }) {
  return (
    <table className="runs">
      <thead>
        <tr>
          <th>Run</th>
          <th>Workflow</th>
          <th>State</th>
          <th className="wide">Step</th>
          <th className="wide">Done, by step</th>
          <th className="r wide">Left</th>
          {isHistory && <th className="wide">Started</th>}
          {isHistory && <th className="wide">By</th>}
        </tr>
      </thead>
      <tbody>
        {runs.map((run) => (
          <Row key={run.id} run={run} isHistory={isHistory} />
        ))}
      </tbody>
    </table>
  );
}

function Row({ run, isHistory }: { run: RunRow; isHistory: boolean }) {
  const state = runOutcome(run);
  const done = run.steps_total ? run.steps_done / run.steps_total : 0;
  const isMoving = state.look === "running";
  const look = isMoving ? (run.mode === "sim" ? "sim" : "") : "off";
  return (
    <tr data-testid="run-row" data-state={run.state}>
      <td>
        <Link className="b num" to={`/runs/${run.id}`}>
          #{run.number}
        </Link>
      </td>
      <td>
        <span className="wf">
          <ModeChip mode={run.mode} />
          <span className="cut">
            {run.workflow.name} <span className="m">v{run.workflow.version}</span>
          </span>
        </span>
      </td>
      <td>
        <span className="chips">
          <StateChip state={state} />
          {run.in_doubt_count > 0 && (
            <StateChip state={{ look: "doubt", word: `${run.in_doubt_count} in doubt` }} />
          )}
        </span>
      </td>
      <td className="wide s">
        <div className="stepcell">{stepText(run)}</div>
      </td>
      <td className="wide">
        <Progress share={done} look={look} />
      </td>
      <td className="r num wide">
        {run.left_s === null || run.state === "paused" ? "–" : formatDuration(run.left_s)}
      </td>
      {isHistory && (
        <td className="wide s">
          <At at={run.started_at ?? run.created_at} />
        </td>
      )}
      {isHistory && <td className="wide s">{run.created_by}</td>}
    </tr>
  );
}

function stepText(run: RunRow): string {
  if (run.waits_for) return sentence(run.waits_for.text);
  const place = Math.min(run.steps_done + 1, run.steps_total);
  if (run.step_now) return `${place} of ${run.steps_total} · ${run.step_now}`;
  return `${run.steps_done} of ${run.steps_total} done`;
}
