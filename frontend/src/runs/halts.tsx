/** Which devices of an aborted run stand, which are being halted, and which cannot be yet. */

import { Link } from "react-router";
import { haltState } from "@/model/states";
import type { Run } from "@/model/wire";
import { Card } from "@/ui/card";
import { StateChip } from "@/ui/state";
import { words } from "./words";

export function Halts({ run }: { run: Run }) {
  if (!run.is_given_up) return null;
  return (
    <Card title={words.halts.title} testId="halts">
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
    </Card>
  );
}
