/** Taking steps away: what came before them still comes before what followed them. */

import { freeEdgeId, makeStep, type Edit } from "./document";
import type { WorkflowDocument, WorkflowEdge, WorkflowStep } from "./wire";

/** What has to be put in the place of the steps that go. */
export interface Bridges {
  /** Connections to be added; their ids come with the edit. */
  links: Omit<WorkflowEdge, "id">[];
  /** Vessels that steps which stay had from one that goes: by step, by field. */
  vessels: Map<string, Record<string, unknown>>;
}

const START = "start";
const DONE = "done";

interface End {
  step: string;
  port: string;
}

/** What keeps the order, and the vessels, of the steps that stay when `ids` go. */
export function bridgesOf(document: WorkflowDocument, ids: Iterable<string>): Bridges {
  const gone = new Set(ids);
  const into = group(document.edges, (edge) => edge.target);
  const steps = new Map(document.steps.map((step) => [step.id, step]));
  const links: Bridges["links"] = [];
  const vessels: Bridges["vessels"] = new Map();
  const ordered: Bridges["links"] = [];
  for (const [target, edges] of into) {
    if (gone.has(target) || !steps.has(target)) continue;
    const cut = edges.filter((edge) => gone.has(edge.source));
    for (const edge of cut) {
      if (edge.target_port === START) continue;
      const from = vesselFrom(edge, into, gone, steps);
      if (from && "step" in from && from.step !== target) {
        links.push(link(from, { step: target, port: edge.target_port }));
      } else if (from && "vessel" in from && !steps.get(target)?.params[edge.target_port]) {
        vessels.set(target, { ...vessels.get(target), [edge.target_port]: from.vessel });
      }
    }
    for (const source of before(cut, into, gone)) {
      if (source !== target && steps.has(source)) {
        ordered.push(link({ step: source, port: DONE }, { step: target, port: START }));
      }
    }
  }
  const kept = document.edges.filter((edge) => !gone.has(edge.source) && !gone.has(edge.target));
  return { links: [...links, ...needed(ordered, [...kept, ...links])], vessels };
}

/** Delete steps, and lead from what came before them to what followed them. */
export function removeSteps(ids: readonly string[]): Edit {
  const gone = new Set(ids);
  return {
    label: gone.size === 1 ? "delete step" : `delete ${gone.size} steps`,
    apply: (document) => {
      const { links, vessels } = bridgesOf(document, gone);
      document.steps = document.steps
        .filter((step) => !gone.has(step.id))
        .map((step) => withVessels(step, vessels.get(step.id)));
      // A new connection takes no id of one that goes: whoever has picked that has not picked this.
      for (const bridge of links) document.edges.push({ id: freeEdgeId(document), ...bridge });
      document.edges = document.edges.filter((e) => !gone.has(e.source) && !gone.has(e.target));
    },
  };
}

/** What a deletion did, for the person who asked for it; steps by their places before it. */
export function removedText(document: WorkflowDocument, ids: readonly string[]): string {
  const place = new Map(document.steps.map((step, index) => [step.id, index + 1]));
  const numbers = document.steps
    .filter((step) => ids.includes(step.id))
    .map((s) => place.get(s.id));
  const { links, vessels } = bridgesOf(document, ids);
  const what =
    numbers.length === 1
      ? `Step ${numbers[0]} was deleted`
      : `${numbers.length} steps were deleted`;
  const pairs = new Map(links.map((one) => [`${one.source} ${one.target}`, one]));
  // The steps after it take other numbers at once, so the old number is named as such.
  const first = Math.min(...numbers.map(Number));
  const named = (id: string): string => {
    const number = place.get(id) ?? 0;
    return number > first ? `the former step ${number}` : `step ${number}`;
  };
  const leads = [...pairs.values()].map(
    (one) => `${named(one.source)} now leads to ${named(one.target)}`,
  );
  const kept = [...vessels.keys()].map((id) => `${named(id)} keeps its vessel`);
  const told = [...leads, ...kept];
  if (told.length === 0) return `${what}.`;
  const more = told.length - 2;
  if (more <= 0) return `${what}; ${told.join(" and ")}.`;
  return `${what}; ${told.slice(0, 2).join(", ")}, and ${more} more connections keep the order.`;
}

function link(from: End, into: End): Omit<WorkflowEdge, "id"> {
  return {
    source: from.step,
    source_port: from.port,
    target: into.step,
    target_port: into.port,
  };
}

function withVessels(step: WorkflowStep, vessels?: Record<string, unknown>): WorkflowStep {
  if (!vessels) return step;
  return makeStep(step.id, step.kind, { ...step.params, ...vessels }, step.position, step.note);
}

/** Where the vessel that an edge carries comes from once the steps are gone; null: from nowhere. */
function vesselFrom(
  edge: WorkflowEdge,
  into: ReadonlyMap<string, WorkflowEdge[]>,
  gone: ReadonlySet<string>,
  steps: ReadonlyMap<string, WorkflowStep>,
): End | { vessel: unknown } | null {
  const seen = new Set<string>();
  let at = edge;
  while (gone.has(at.source)) {
    if (seen.has(at.id)) return null;
    seen.add(at.id);
    const port = at.source_port;
    const feeder = into.get(at.source)?.find((one) => one.target_port === port);
    const named = steps.get(at.source)?.params[port];
    if (!feeder) return named === undefined ? null : { vessel: named };
    at = feeder;
  }
  return { step: at.source, port: at.source_port };
}

/** The nearest steps that stay among all that come before these edges. */
function before(
  edges: readonly WorkflowEdge[],
  into: ReadonlyMap<string, WorkflowEdge[]>,
  gone: ReadonlySet<string>,
): Set<string> {
  const found = new Set<string>();
  const seen = new Set<string>();
  const open = edges.map((edge) => edge.source);
  for (let step = open.pop(); step !== undefined; step = open.pop()) {
    if (seen.has(step)) continue;
    seen.add(step);
    if (gone.has(step)) open.push(...(into.get(step) ?? []).map((edge) => edge.source));
    else found.add(step);
  }
  return found;
}

/** Those links without which the order would be lost: what other ways say already is left out. */
function needed(
  links: Bridges["links"],
  others: readonly { source: string; target: string }[],
): Bridges["links"] {
  const next = new Map<string, Map<string, number>>();
  const count = (from: string, to: string, by: number): void => {
    const row = next.get(from) ?? new Map<string, number>();
    row.set(to, (row.get(to) ?? 0) + by);
    next.set(from, row);
  };
  for (const one of [...others, ...links]) count(one.source, one.target, 1);
  const isReached = (from: string, to: string): boolean => {
    const seen = new Set<string>();
    const open = [from];
    for (let step = open.pop(); step !== undefined; step = open.pop()) {
      if (step === to) return true;
      if (seen.has(step)) continue;
      seen.add(step);
      for (const [later, ways] of next.get(step) ?? []) if (ways > 0) open.push(later);
    }
    return false;
  };
  return links.filter(({ source, target }) => {
    count(source, target, -1);
    if (isReached(source, target)) return false;
    count(source, target, 1);
    return true;
  });
}

function group<T>(items: readonly T[], keyOf: (item: T) => string): Map<string, T[]> {
  const groups = new Map<string, T[]>();
  for (const item of items) {
    const key = keyOf(item);
    const found = groups.get(key);
    if (found) found.push(item);
    else groups.set(key, [item]);
  }
  return groups;
}
