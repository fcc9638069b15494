/** The abort of a run: who wanted it and why, which devices stand, and what never began. */

import { Link } from "react-router";
import { neverBegan } from "@/model/runs";
import { haltState } from "@/model/states";
import type { Run } from "@/model/wire";
import { Card } from "@/ui/card";
import { StateChip } from "@/ui/state";
import { At } from "@/ui/time";
import { words } from "./words";

export function Halts({ run }: { run: Run }) {
  if (!run.is_given_up) return null;
  const left = neverBegan(run);
  return (
    <Card
      title={run.given_up ? words.halts.by(run.given_up.by) : words.halts.title}
      note={run.given_up && <At at={run.given_up.at} seconds />}
      testId="halts"
    >
      {run.given_up && <q className="help note">{run.given_up.reason}</q>}
      {run.halts.length === 0 && <p className="help note">{words.halts.none}</p>}
      <ul className="halts">
        {run.halts.map((halt) => (
          <li key={halt.id} data-testid="halt" data-state={halt.state}>
            <Link className="link b" to={`/devices/${halt.device.id}`}>
              {halt.device.name}
            </Link>
            <StateChip state={haltState(halt)} />
            {halt.message && <span className="s">{halt.message}</span>}
          </li>
        ))}
      </ul>
      {left.length > 0 && (
        <details className="neverbegan" data-testid="never-began">
          <summary>{words.halts.neverBegan(left.length)}</summary>
          <ol>
            {left.map((job) => (
              <li key={job.id} className="s">
                {job.sentence}
              </li>
            ))}
          </ol>
        </details>
      )}
    </Card>
  );
}
