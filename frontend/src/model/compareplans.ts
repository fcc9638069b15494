/** Two plans of one recipe on two rigs: what is added, left out, or done otherwise. */

import type { Claim, PlannedStep, RecipePlan, Rig } from "./wirerecipe";

export interface Side {
  plan: RecipePlan;
  rig: Rig;
}

export interface StepChange {
  /** `+` only after, `−` only before, `~` another amount or place, `=` the same done otherwise. */
  sign: "+" | "−" | "~" | "=";
  before: PlannedStep | null;
  after: PlannedStep | null;
}

export interface Difference {
  name: string;
  before: number;
  after: number;
}

export interface Comparison {
  steps: StepChange[];
  same_count: number;
  needed_ul: Difference[];
  needed_ug: Difference[];
}

const PLACES = ["from", "to", "vessel", "lower_to", "upper_to"];
const LISTS = ["also", "through", "lower_through", "upper_through"];

/** Names of a graph's nodes by what they are in the recipe; a spare one goes by its sort. */
function rolesOf({ plan, rig }: Side): (key: string) => string {
  const sorts = rig.nodes.map((node): [string, string] => [
    node.key,
    `a ${node.sort ?? node.kind}`,
  ]);
  const roles = new Map(sorts);
  for (const [lot, keys] of Object.entries(plan.bindings.reagents)) {
    for (const key of [keys].flat()) roles.set(key, `flask of ${lot}`);
  }
  for (const [role, key] of Object.entries(plan.bindings.vessels)) roles.set(key, role);
  return (key) => {
    const [owner = key, part] = key.split("#");
    return (roles.get(owner) ?? owner) + (part ? `#${part}` : "");
  };
}

function inRoles(claim: Claim, role: (key: string) => string): Record<string, unknown> {
  return Object.fromEntries(
    Object.entries(claim).map(([name, value]) => {
      if (PLACES.includes(name) && typeof value === "string") return [name, role(value)];
      if (LISTS.includes(name) && Array.isArray(value)) return [name, value.map(String).map(role)];
      return [name, value];
    }),
  );
}

const ordered = (value: Record<string, unknown>): string =>
  JSON.stringify(Object.entries(value).sort(([a], [b]) => a.localeCompare(b)));

interface Keyed {
  step: PlannedStep;
  whole: string;
  alike: string;
}

function keyed(side: Side): Keyed[] {
  const role = rolesOf(side);
  return side.plan.steps.map((step) => {
    const claim = inRoles(step.does, role);
    const head = `${step.of.act} ${step.of.operation} ${step.does.kind}`;
    const what = { vessel: claim.vessel, from: claim.from, to: claim.to, lot: claim.lot };
    return { step, whole: head + ordered(claim), alike: head + ordered(what) };
  });
}

/** Pair what has the same key, in order; return the pairs and what is left of both. */
function paired(
  before: Keyed[],
  after: Keyed[],
  key: "whole" | "alike",
): { pairs: [Keyed, Keyed][]; before: Keyed[]; after: Keyed[] } {
  const waiting = new Map<string, Keyed[]>();
  for (const one of before) waiting.set(one[key], [...(waiting.get(one[key]) ?? []), one]);
  const pairs: [Keyed, Keyed][] = [];
  const left: Keyed[] = [];
  for (const one of after) {
    const other = waiting.get(one[key])?.shift();
    if (other) pairs.push([other, one]);
    else left.push(one);
  }
  const met = new Set(pairs.map(([one]) => one));
  return { pairs, before: before.filter((one) => !met.has(one)), after: left };
}

/** What is done, whatever the devices are called: names of actions, group by group. */
const shapeOf = (step: PlannedStep): string =>
  JSON.stringify(step.actions.map((group) => group.map((one) => one.action)));

const doneAlike = (before: PlannedStep, after: PlannedStep): boolean =>
  before.estimate_s === after.estimate_s && shapeOf(before) === shapeOf(after);

export function comparePlans(before: Side, after: Side): Comparison {
  const same = paired(keyed(before), keyed(after), "whole");
  const near = paired(same.before, same.after, "alike");
  const change = (
    sign: StepChange["sign"],
    old: Keyed | null,
    fresh: Keyed | null,
  ): StepChange => ({ sign, before: old?.step ?? null, after: fresh?.step ?? null });
  const steps = [
    ...same.pairs
      .filter(([old, fresh]) => !doneAlike(old.step, fresh.step))
      .map(([old, fresh]) => change("=", old, fresh)),
    ...near.pairs.map(([old, fresh]) => change("~", old, fresh)),
    ...near.before.map((old) => change("−", old, null)),
    ...near.after.map((fresh) => change("+", null, fresh)),
  ];
  const at = ({ after: fresh, before: old }: StepChange): [number, number] => {
    const step = fresh ?? old;
    return [step?.of.act ?? 0, step?.id ?? 0];
  };
  steps.sort((a, b) => at(a)[0] - at(b)[0] || at(a)[1] - at(b)[1]);
  return {
    steps,
    same_count: same.pairs.filter(([old, fresh]) => doneAlike(old.step, fresh.step)).length,
    needed_ul: amounts(before.plan.totals.needed_ul, after.plan.totals.needed_ul),
    needed_ug: amounts(before.plan.totals.needed_ug, after.plan.totals.needed_ug),
  };
}

function amounts(before: Record<string, number>, after: Record<string, number>): Difference[] {
  const names = [...new Set([...Object.keys(before), ...Object.keys(after)])].sort();
  return names.map((name) => ({ name, before: before[name] ?? 0, after: after[name] ?? 0 }));
}
