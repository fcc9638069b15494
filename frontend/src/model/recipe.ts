/** A recipe on a rig as a person reads it: lines, sentences, routes, and two plans side by side. */

import {
  formatArguments,
  formatDuration,
  formatNumber,
  formatVolume,
  splitMass,
  THIN,
} from "./format";
import type {
  Claim,
  PlannedAction,
  PlannedStep,
  RecipeFinding,
  RecipePlan,
  Rig,
  RigTube,
} from "./wirerecipe";

export const RECIPES = ".xdl,.xml,.json,.xdlexe";
export const GRAPHS = ".json,.graphml,.gz";

/** Files of 1.4 MB, packed for a request, are as large as the server reads. */
export const MOST_BYTES = 1_400_000;

/** Text of a recipe in the encoding that it declares; what is no such text is shown as it is. */
export function decodeRecipe(bytes: Uint8Array): string {
  const marks = `${bytes[0] ?? 0},${bytes[1] ?? 0}`;
  if (marks === "255,254") return new TextDecoder("utf-16le").decode(bytes);
  if (marks === "254,255") return new TextDecoder("utf-16be").decode(bytes);
  const head = new TextDecoder("latin1").decode(bytes.slice(0, 200));
  const declared = /^<\?xml[^>]*encoding\s*=\s*["']([\w-]{1,20})["']/.exec(head)?.[1];
  const isLatin = declared !== undefined && /^iso-8859-1$/i.test(declared);
  return new TextDecoder(isLatin ? "latin1" : "utf-8").decode(bytes);
}

export const linesOf = (text: string): string[] => text.split(/\r\n|\n|\r/);

/** Line of the recipe that a finding speaks of, or null. */
export function lineOf(finding: RecipeFinding): number | null {
  const line = finding.context.line;
  return typeof line === "number" ? line : null;
}

const text = (value: unknown): string => (typeof value === "string" ? value : "");

const volumeOf = (claim: Claim): string => {
  if (typeof claim.volume_ul === "number") return formatVolume(claim.volume_ul * 1000);
  const most = claim.most_ul;
  return typeof most === "number" ? `all, at most ${formatVolume(most * 1000)},` : "all";
};

const massOf = (claim: Claim): string =>
  typeof claim.mass_ug === "number" ? splitMass(claim.mass_ug).join(THIN) : "";

const SENTENCES: Record<string, (claim: Claim) => string> = {
  fill: (c) => `Fill ${volumeOf(c)} of ${text(c.lot)} into ${text(c.to)}`,
  add_solid: (c) => `Add ${massOf(c)} of ${text(c.lot)} to ${text(c.to)}`,
  empty: (c) => `Empty ${text(c.vessel)}`,
  transfer: (c) => {
    const lot = text(c.lot);
    return `Move ${volumeOf(c)}${lot ? ` of ${lot}` : ""} from ${text(c.from)} to ${text(c.to)}`;
  },
  clean: (c) => `Rinse with ${volumeOf(c)} of ${text(c.lot)} from ${text(c.from)} to ${text(c.to)}`,
  flush: (c) => `Flush with ${volumeOf(c)} from ${text(c.from)} to ${text(c.to)}`,
  separate: (c) =>
    `Part the phases in ${text(c.vessel)}: lower to ${text(c.lower_to)}, upper to ${text(c.upper_to)}`,
  stir: (c) => `Stir ${text(c.vessel)} at ${formatNumber(Number(c.speed_rpm))}${THIN}rpm`,
  stop_stir: (c) => `Stop stirring ${text(c.vessel)}`,
  heat: (c) =>
    `Heat or chill ${text(c.vessel)} to ${formatNumber(Number(c.temperature_c))}${THIN}°C`,
  stop_heat: (c) => `Stop heating or chilling ${text(c.vessel)}`,
  filter: (c) => `Filter ${text(c.vessel)} into ${text(c.to)}`,
  wait: (c) => `Wait ${formatDuration(Number(c.duration_s))}`,
  reach: (c) =>
    `Wait until ${text(c.vessel)} is between ${formatNumber(Number(c.low_c))} and ${formatNumber(Number(c.high_c))}${THIN}°C`,
  ask: (c) => `Ask: ${text(c.text)}`,
};

/** What a step brings about, in one sentence. */
export function claimText(claim: Claim): string {
  const known = SENTENCES[claim.kind];
  if (known) return known(claim);
  const { kind, vessel, ...rest } = claim;
  const words = kind.replaceAll("_", " ");
  const more = formatArguments(rest);
  return `${words.charAt(0).toUpperCase()}${words.slice(1)} ${text(vessel)}${more ? `: ${more}` : ""}`;
}

/** One action of a device as words; what is done by hand says it itself. */
export function actionText(action: PlannedAction): string {
  if (typeof action.parameters.text === "string") return action.parameters.text;
  const words = action.action.replaceAll("_", " ");
  const more = formatArguments(action.parameters);
  return more ? `${words}: ${more}` : words;
}

const OWN_NAMES: Record<string, string> = { "@by_hand": "By hand", "@timer": "Timer" };

export const deviceText = (device: string): string => OWN_NAMES[device] ?? device;

export interface Section {
  /** Of the recipe's step, and unlike that of any other. */
  id: string;
  operation: string;
  line: number | null;
  steps: PlannedStep[];
  estimate_s: number;
}

/** Steps of the plan under the step of the recipe that they come from, in the order of doing. */
export function sectionsOf(plan: RecipePlan): Section[] {
  const found: Section[] = [];
  for (const step of plan.steps) {
    const { operation, act, line } = step.of;
    const last = found[found.length - 1];
    const first = last?.steps[0];
    if (last && first?.of.act === act && first.of.operation === operation) {
      last.steps.push(step);
      last.estimate_s += step.estimate_s;
    } else {
      const id = `${act}-${operation}-${step.id}`;
      const { estimate_s } = step;
      found.push({ id, operation, line: line ?? null, steps: [step], estimate_s });
    }
  }
  return found;
}

export interface Link {
  id: string;
  source: string;
  target: string;
  tubes: RigTube[];
}

/** What the graph joins, one line for all tubes between two nodes. */
export function linksOf(rig: Rig): Link[] {
  const found = new Map<string, Link>();
  for (const tube of rig.tubes) {
    const ends = [tube.source, tube.target].sort();
    const id = ends.join("\u0000");
    const link = found.get(id);
    if (link) link.tubes.push(tube);
    else found.set(id, { id, source: tube.source, target: tube.target, tubes: [tube] });
  }
  return [...found.values()];
}

/** Tubes of a route as words, each once however it is drawn. */
export function routeText(rig: Rig, route: readonly string[]): string[] {
  const wanted = new Set(route);
  const end = (key: string, port: string): string => (port ? `${key} port ${port}` : key);
  const found = rig.tubes
    .filter((tube) => wanted.has(tube.key))
    .map((tube) =>
      [end(tube.source, tube.source_port), end(tube.target, tube.target_port)].sort().join(" – "),
    );
  return [...new Set(found)];
}
