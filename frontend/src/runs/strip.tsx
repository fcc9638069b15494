/** The steps of a run in a row: done, running, planned, and what is in the way. */

import { formatDuration } from "@/model/format";
import type { StepProgress, StepState } from "@/model/runs";
import { capitalise } from "@/model/states";
import { Glyph } from "@/ui/glyph";
import { useLabTime, useNow } from "@/ui/time";

const CLASSES: Record<StepState, string> = {
  planned: "plan",
  waiting: "wait",
  running: "run",
  done: "done",
  "by hand": "done",
  skipped: "wait",
  doubt: "doubt",
  failed: "bad",
};

interface StripProps {
  steps: StepProgress[];
  picked: string | null;
  onPick: (stepId: string) => void;
}

export function StepStrip({ steps, picked, onPick }: StripProps) {
  return (
    <section className="card" aria-label="Steps">
      <ol className="strip">
        {steps.map((step) => (
          <li
            key={step.step.step_id}
            className={`nd ${CLASSES[step.state]}`}
            data-step={step.step.step_id}
            data-state={step.state}
            data-testid={`run-step-${step.step.step_id}`}
            aria-current={picked === step.step.step_id ? "step" : undefined}
          >
            <button
              type="button"
              title={step.step.sentence}
              onClick={() => onPick(step.step.step_id)}
            >
              <span className="nh">
                <span className="st">
                  <Glyph look={step.look} />
                  <span className="vh">{capitalise(step.state)}</span>
                </span>
                <span className="num m">{step.number}</span>
                <i className="sp" />
                <span className="num m">
                  <StepTime step={step} />
                </span>
              </span>
              <span className="nt">{step.step.sentence}</span>
              {step.after !== null && <span className="nt m">after {step.after}</span>}
              {isByPerson(step.state) && <span className="nt b">{step.state}</span>}
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}

/** A person left it out, or did it: whoever looks at the row must not take it for a device's work. */
const isByPerson = (state: StepState): boolean => state === "skipped" || state === "by hand";

function StepTime({ step }: { step: StepProgress }) {
  const now = useNow();
  const time = useLabTime();
  if (step.state === "skipped") return null;
  if (step.state === "doubt" && step.started_s !== null) return <>{time.minute(step.started_s)}</>;
  if (step.started_s !== null) return <>{formatDuration((step.ended_s ?? now) - step.started_s)}</>;
  if (step.state === "waiting") return null;
  return <>≈ {formatDuration(step.step.estimate_s)}</>;
}
