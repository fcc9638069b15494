/** Steps of the plan under those of the recipe, each unfolding to its actions. */

import { useMemo, useState, type KeyboardEvent } from "react";
import {
  actionText,
  claimText,
  deviceText,
  routeText,
  sectionsOf,
  type Section,
} from "@/model/recipe";
import { formatDuration } from "@/model/format";
import type { PlannedStep, RecipePlan, Rig } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Button } from "@/ui/controls";
import { Icon } from "@/ui/icons";
import { words } from "./words";

const MOST_SECTIONS = 200;

interface Picking {
  rig: Rig;
  picked: number | null;
  onPick: (id: number | null) => void;
}

export function StepsCard({ plan, rig, picked, onPick }: { plan: RecipePlan } & Picking) {
  const sections = useMemo(() => sectionsOf(plan), [plan]);
  const [most, setMost] = useState(MOST_SECTIONS);
  return (
    <Card title={words.steps} note={String(plan.steps.length)} testId="recipe-steps">
      <ol className="rsteps" onKeyDown={byArrows}>
        {sections.slice(0, most).map((section) => (
          <SectionRows
            key={section.id}
            section={section}
            rig={rig}
            picked={picked}
            onPick={onPick}
          />
        ))}
      </ol>
      {sections.length > most && (
        <div className="state-note">
          <Button onClick={() => setMost(sections.length)}>
            Show {sections.length - most} more steps of the recipe
          </Button>
        </div>
      )}
    </Card>
  );
}

/** The arrows go from step to step. */
function byArrows(event: KeyboardEvent<HTMLElement>): void {
  const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!by) return;
  const all = [...event.currentTarget.querySelectorAll<HTMLElement>("[data-step] > .pick")];
  const next = all[all.findIndex((one) => one === document.activeElement) + by];
  if (!next || !all.includes(document.activeElement as HTMLElement)) return;
  event.preventDefault();
  next.focus();
}

function SectionRows({ section, rig, picked, onPick }: { section: Section } & Picking) {
  return (
    <li className="rsection" data-testid="recipe-section" data-operation={section.operation}>
      <h3>
        {section.operation}
        {section.line !== null && <span className="m num"> line {section.line}</span>}
        <i className="sp" />
        <span className="m num">{formatDuration(section.estimate_s)}</span>
      </h3>
      <ol>
        {section.steps.map((step) => (
          <StepRow
            key={step.id}
            step={step}
            rig={rig}
            isPicked={step.id === picked}
            onPick={onPick}
          />
        ))}
      </ol>
    </li>
  );
}

function StepRow(props: {
  step: PlannedStep;
  rig: Rig;
  isPicked: boolean;
  onPick: (id: number | null) => void;
}) {
  const { step, isPicked } = props;
  const [isOpen, setOpen] = useState(false);
  const count = step.actions.reduce((sum, group) => sum + group.length, 0);
  const told = `${count} ${count === 1 ? "action" : "actions"}`;
  return (
    <li
      className={`rstep ${isPicked ? "picked" : ""}`}
      data-testid="planned-step"
      data-step={step.id}
    >
      <button
        type="button"
        className="pick"
        aria-pressed={isPicked}
        onClick={() => props.onPick(isPicked ? null : step.id)}
      >
        <span className="no num m">{step.id}</span>
        <span className="what">{claimText(step.does)}</span>
        <span className="num m">{formatDuration(step.estimate_s)}</span>
      </button>
      <button
        type="button"
        className="unfold"
        aria-expanded={isOpen}
        aria-label={`${told} of step ${step.id}`}
        onClick={() => setOpen(!isOpen)}
      >
        <Icon name={isOpen ? "down" : "right"} />
        <span className="t12 num wide">{told}</span>
      </button>
      {isPicked && <Route rig={props.rig} step={step} />}
      {isOpen && <Actions step={step} />}
    </li>
  );
}

/** The route in words, for whoever does not see the picture. */
function Route({ rig, step }: { rig: Rig; step: PlannedStep }) {
  const tubes = routeText(rig, step.route);
  if (!tubes.length) return <p className="m routewords">{words.noRoute}</p>;
  return (
    <ul className="routewords" aria-label={words.route} data-testid="route">
      {tubes.map((tube) => (
        <li key={tube} data-testid="route-tube">
          {tube}
        </li>
      ))}
    </ul>
  );
}

/** Groups below each other; what happens at the same time stands side by side. */
function Actions({ step }: { step: PlannedStep }) {
  return (
    <ol className="groups" data-testid="actions">
      {step.actions.map((group, place) => (
        <li key={place} data-count={group.length}>
          {group.map((action, index) => (
            <div key={index} className="act" data-testid="planned-action">
              <span className="b">{deviceText(action.device)}</span>
              <span>{actionText(action)}</span>
            </div>
          ))}
        </li>
      ))}
    </ol>
  );
}
