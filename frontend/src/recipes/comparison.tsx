/** The plan on this rig beside the plan on another. */

import { useMemo } from "react";
import { askedOn, useOpened } from "@/api/opened";
import { useOpening } from "@/api/recipes";
import {
  comparePlans,
  type Comparison,
  type Difference,
  type Side,
  type StepChange,
} from "@/model/compareplans";
import { formatDuration, formatVolume } from "@/model/format";
import { claimText } from "@/model/recipe";
import type { Opening, PlannedStep, RecipePlan } from "@/model/wirerecipe";
import { Card, Empty, Loaded } from "@/ui/card";
import { massText } from "./totals";
import { words } from "./words";

const sideOf = (opening: Opening): Side | null =>
  opening.plan && opening.rig ? { plan: opening.plan, rig: opening.rig } : null;

export function ComparisonCard({ now }: { now: Opening | null }) {
  const state = useOpened();
  const { rigs, rigId, againstId } = state;
  const isAsked = againstId !== null && againstId !== rigId;
  const other = useOpening(isAsked ? askedOn(state, againstId) : null);
  if (!isAsked) return null;
  const nameOf = (id: string): string => rigs.find((rig) => rig.id === id)?.name ?? "";
  const names: [string, string] = [nameOf(againstId), nameOf(rigId)];
  return (
    <Card title={words.difference} note={`${names[0]} → ${names[1]}`} testId="difference">
      <Loaded source={other} what="the other plan">
        {(before) => <Both before={before} after={now} names={names} />}
      </Loaded>
    </Card>
  );
}

function Both(props: { before: Opening; after: Opening | null; names: [string, string] }) {
  const { before, after, names } = props;
  const sides = useMemo(() => [sideOf(before), after && sideOf(after)] as const, [before, after]);
  const found = useMemo(
    () => (sides[0] && sides[1] ? comparePlans(sides[0], sides[1]) : null),
    [sides],
  );
  if (!after) return <Empty>{words.compiling}</Empty>;
  if (!sides[0]) return <Empty>{`${names[0]} ${words.noPlanThere}`}</Empty>;
  if (!sides[1]) return <Empty>{`${names[1]} ${words.noPlanThere}`}</Empty>;
  if (!found) return null;
  const [old, fresh] = [sides[0].plan, sides[1].plan];
  const count = (sign: string): number => found.steps.filter((one) => one.sign === sign).length;
  return (
    <>
      <Totals found={found} old={old} fresh={fresh} names={names} />
      <p className="help inset" data-testid="difference-counts">
        {found.steps.length === 0
          ? words.noDifference
          : `${count("+")} ${words.added}, ${count("−")} ${words.removed}, ${count("~")} ${words.changed}, ${count("=")} ${words.otherwise}`}
      </p>
      {found.steps.length > 0 && (
        <ul className="diffsteps">
          {found.steps.map((change, place) => (
            <Change key={place} change={change} />
          ))}
        </ul>
      )}
    </>
  );
}

function Totals(props: {
  found: Comparison;
  old: RecipePlan;
  fresh: RecipePlan;
  names: [string, string];
}) {
  const { found, old, fresh, names } = props;
  return (
    <table className="difftable">
      <thead>
        <tr>
          <th />
          <th className="r cut">{names[0]}</th>
          <th className="r cut">{names[1]}</th>
        </tr>
      </thead>
      <tbody>
        <Row
          name={words.steps}
          before={String(old.steps.length)}
          after={String(fresh.steps.length)}
        />
        <Row
          name={words.duration}
          before={formatDuration(old.totals.duration_s)}
          after={formatDuration(fresh.totals.duration_s)}
        />
        <Row
          name={words.critical}
          before={formatDuration(old.totals.critical_path_s)}
          after={formatDuration(fresh.totals.critical_path_s)}
        />
        <Row
          name={words.byHand}
          before={String(old.totals.by_hand_count)}
          after={String(fresh.totals.by_hand_count)}
        />
        <Amounts rows={found.needed_ul} text={(amount) => formatVolume(amount * 1000)} />
        <Amounts rows={found.needed_ug} text={massText} />
      </tbody>
    </table>
  );
}

function Row(props: { name: string; before: string; after: string }) {
  const isOther = props.before !== props.after;
  return (
    <tr className={isOther ? "other" : ""} data-testid="difference-row" data-name={props.name}>
      <td>{props.name}</td>
      <td className="r num">{props.before}</td>
      <td className="r num">{props.after}</td>
    </tr>
  );
}

function Amounts(props: { rows: Difference[]; text: (amount: number) => string }) {
  return props.rows.map((row) => (
    <Row
      key={row.name}
      name={row.name}
      before={props.text(row.before)}
      after={props.text(row.after)}
    />
  ));
}

const WORDS = {
  "+": words.added,
  "−": words.removed,
  "~": words.changed,
  "=": words.otherwise,
};

function Change({ change }: { change: StepChange }) {
  const { before, after, sign } = change;
  return (
    <li data-testid="step-change" data-sign={sign}>
      <span className="sign b" title={WORDS[sign]} aria-label={WORDS[sign]}>
        {sign}
      </span>
      <span className="tx2">
        {before && after ? (
          <Otherwise before={before} after={after} sign={sign} />
        ) : (
          <Plain step={after ?? before} />
        )}
      </span>
    </li>
  );
}

function Plain({ step }: { step: PlannedStep | null }) {
  if (!step) return null;
  return (
    <span>
      {step.of.operation}: {claimText(step.does)}
    </span>
  );
}

const howOf = (step: PlannedStep): string => {
  const count = step.actions.flat().length;
  return `${count} ${count === 1 ? "action" : "actions"}, ${formatDuration(step.estimate_s)}`;
};

function Otherwise(props: { before: PlannedStep; after: PlannedStep; sign: StepChange["sign"] }) {
  const { before, after, sign } = props;
  return (
    <>
      <Plain step={after} />
      <span className="t12 m">
        {sign === "~" && `was: ${claimText(before.does)}; `}
        {howOf(before)} → {howOf(after)}
      </span>
    </>
  );
}
