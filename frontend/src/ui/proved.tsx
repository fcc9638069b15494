/** What of a plan was carried out on paper, and what no proof covers and why. */

import type { Plan } from "@/model/wire";
import { Glyph } from "./glyph";
import { StateChip } from "./state";

/** In full, where somebody decides about a plan. */
export function ProvedPlan({ plan }: { plan: Plan }) {
  if (!plan.proved) return null;
  const { steps, beyond } = plan.proved;
  if (steps.length === 0 && beyond.length === 0) return null;
  return (
    <div className="provedplan" data-testid="proved">
      {steps.length > 0 && (
        <p className="ts tone-ok">
          <Glyph look="ok" /> {carriedOut(steps.length)}
        </p>
      )}
      {beyond.length > 0 && (
        <>
          <p className="ts b tone-needs">
            <Glyph look="needs" /> Not proved:
          </p>
          <ul className="reasons">
            {beyond.map((one) => (
              <li key={one.step_id}>{`${sentenceOf(plan, one.step_id)}: ${one.why}.`}</li>
            ))}
          </ul>
        </>
      )}
    </div>
  );
}

/** In a word, beside the state of a run. */
export function ProvedChip({ plan }: { plan: Plan }) {
  if (!plan.proved) return null;
  const { steps, beyond } = plan.proved;
  if (steps.length === 0 && beyond.length === 0) return null;
  const told = [
    ...(steps.length > 0 ? [carriedOut(steps.length)] : []),
    ...beyond.map((one) => `Not proved: ${sentenceOf(plan, one.step_id)}: ${one.why}.`),
  ];
  const word = beyond.length === 0 ? "Plan proved" : "Plan proved in part";
  return (
    <span title={told.join("\n")} data-testid="proved-chip">
      <StateChip state={{ look: beyond.length === 0 ? "ok" : "needs", word }} />
    </span>
  );
}

function carriedOut(count: number): string {
  return count === 1
    ? "Proved: 1 step that moves or changes matter does what it asks for, and nothing else."
    : `Proved: ${count} steps that move or change matter do what they ask for, and nothing else.`;
}

function sentenceOf(plan: Plan, step: string): string {
  return plan.steps.find((one) => one.step_id === step)?.sentence ?? step;
}
