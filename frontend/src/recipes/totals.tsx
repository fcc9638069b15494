/** Time, amounts and notes of a plan. */

import { formatDuration, formatVolume, splitMass, THIN } from "@/model/format";
import type { RecipePlan } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { words } from "./words";

export const massText = (amountUg: number): string => splitMass(amountUg).join(THIN);

export function TotalsCard({ plan }: { plan: RecipePlan }) {
  const { totals } = plan;
  return (
    <Card title={words.totals} testId="recipe-totals">
      <dl className="kv inset">
        <dt>{words.duration}</dt>
        <dd>{formatDuration(totals.duration_s)}</dd>
        <dt>{words.critical}</dt>
        <dd>{formatDuration(totals.critical_path_s)}</dd>
        <dt>{words.byHand}</dt>
        <dd>
          {totals.by_hand_count} {totals.by_hand_count === 1 ? "time" : "times"}
        </dd>
        {Object.entries(totals.needed_ul).map(([lot, amount]) => (
          <div key={lot} className="fact">
            <dt>{lot}</dt>
            <dd>{formatVolume(amount * 1000)}</dd>
          </div>
        ))}
        {Object.entries(totals.needed_ug).map(([lot, amount]) => (
          <div key={lot} className="fact">
            <dt>{lot}</dt>
            <dd>{massText(amount)}</dd>
          </div>
        ))}
      </dl>
      {plan.notes.length > 0 && (
        <details className="rnotes">
          <summary>
            {words.notes} <span className="m num">{plan.notes.length}</span>
          </summary>
          <ul>
            {plan.notes.map((note) => (
              <li key={note}>{note}</li>
            ))}
          </ul>
        </details>
      )}
    </Card>
  );
}
