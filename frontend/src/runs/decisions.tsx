/** What people decided about this run: which action, what, who, when and why. */

import { decisions } from "@/model/decisions";
import type { Run } from "@/model/wire";
import { Card } from "@/ui/card";
import { At } from "@/ui/time";
import { words } from "./words";

export function Decisions({ run }: { run: Run }) {
  const found = decisions(run);
  if (found.length === 0) return null;
  return (
    <Card title={words.decided} note={String(found.length)} testId="decisions">
      <ol className="decided">
        {found.map((one, place) => (
          <li key={place}>
            <b>{one.what}</b>
            <span className="m num t12">
              {one.by && `${one.by}, `}
              <At at={one.at} seconds />
            </span>
            <span className="s">{one.job.sentence}</span>
            <q className="s">{one.note}</q>
          </li>
        ))}
      </ol>
    </Card>
  );
}
