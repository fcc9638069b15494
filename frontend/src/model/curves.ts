/** Curves over a chosen time: a band from lowest to highest with the mean, gaps as gaps. */

import { isSetpoint } from "./telemetry";
import type { Sample } from "./wire";

export interface Curve {
  status: string;
  label: string;
  unit: string;
  /** It tells yes or no; its buckets tell the share of yes. */
  is_share?: boolean;
  every_s: number | null;
  level_s: number;
  step_s: number;
  /** [at, value] of samples, [begin, mean, lowest, highest, count] of buckets. */
  points: readonly (readonly unknown[])[];
}

export interface Gap {
  since: number;
  until: number;
  lost_count: number | null;
  reason: string;
}

export interface Curves {
  since_s: number;
  until_s: number;
  curves: Curve[];
  gaps: Gap[];
}

export const RANGES = [
  { value: "15min", label: "15 min", span_s: 900, again_s: 15 },
  { value: "1h", label: "1 h", span_s: 3600, again_s: 30 },
  { value: "24h", label: "24 h", span_s: 86400, again_s: 300 },
  { value: "7d", label: "7 d", span_s: 604800, again_s: 600 },
] as const;

export type RangeName = (typeof RANGES)[number]["value"] | "custom";

export const spanOf = (name: RangeName): (typeof RANGES)[number] | undefined =>
  RANGES.find((range) => range.value === name);

/** Why a chosen time cannot be shown; null: it can. */
export function whyNoRange(since: string | null, until: string | null): string | null {
  if (!since || !until) return "Give both times, with date and hour.";
  return Date.parse(since) < Date.parse(until) ? null : "The end must be after the beginning.";
}

const LEVELS: Readonly<Record<number, string>> = { 0: "raw", 1: "1s", 60: "1min", 3600: "1h" };

/** What the buckets of a curve are, in words; samples need none. */
export function stepWords(curve: Curve): string {
  if (!curve.step_s) return "";
  const [size, unit] =
    curve.step_s >= 3600 && curve.step_s % 3600 === 0
      ? [curve.step_s / 3600, "h"]
      : curve.step_s >= 60 && curve.step_s % 60 === 0
        ? [curve.step_s / 60, "min"]
        : [curve.step_s, "s"];
  return `mean of ${size} ${unit}`;
}

/** Name of the coarsest level that was drawn, as an export takes it; samples count as seconds. */
export function levelDrawn(curves: readonly Curve[]): string {
  return LEVELS[Math.max(1, ...curves.map((curve) => curve.level_s))] ?? "1s";
}

export type BandColumns = [
  at: number[],
  mean: (number | null)[],
  low: (number | null)[],
  high: (number | null)[],
  set: (number | null)[],
];

type Row = [at: number, mean: number, low: number, high: number];

const isNumber = (value: unknown): value is number => typeof value === "number";

const yesAsOne = (value: unknown): unknown => (typeof value === "boolean" ? Number(value) : value);

/** Points of a curve in the middle of their buckets; what is no number is no point. */
function rowsOf(curve: Curve): Row[] {
  return curve.points.flatMap((point): Row[] => {
    const [at, mean, low = mean, high = mean] = curve.is_share ? point.map(yesAsOne) : point;
    if (!isNumber(at) || !isNumber(mean) || !isNumber(low) || !isNumber(high)) return [];
    return [[at + curve.step_s / 2, mean, low, high]];
  });
}

/** Curves with what came since they were fetched. */
export function withLive(curves: readonly Curve[], samples: readonly Sample[]): Curve[] {
  return curves.map((curve) => {
    const last = curve.points.at(-1)?.[0];
    const from = isNumber(last) ? last + curve.step_s : -Infinity;
    const fresh = samples
      .filter(([status, at]) => status === curve.status && at > from)
      .map(([, at, value]) =>
        // A sample in the middle of its own bucket.
        curve.step_s ? [at - curve.step_s / 2, value, value, value, 1] : [at, value],
      );
    return fresh.length ? { ...curve, points: [...curve.points, ...fresh] } : curve;
  });
}

/** Curves of numbers, each with its setpoint; what is controlled first, what is yes or no last. */
export function drawable(curves: readonly Curve[]): { curve: Curve; set: Curve | null }[] {
  return curves
    .filter((curve) => !isSetpoint(curve.status) && rowsOf(curve).length > 0)
    .map((curve) => ({
      curve,
      set:
        curves.find(
          (other) =>
            isSetpoint(other.status) && other.status.replace(/_?setpoint/, "") === curve.status,
        ) ?? null,
    }))
    .sort(
      (a, b) =>
        Number(b.set !== null) - Number(a.set !== null) ||
        Number(a.curve.is_share ?? false) - Number(b.curve.is_share ?? false),
    );
}

/** How far apart two points may be before the curve breaks between them. */
export function longestStep(curve: Curve): number {
  const rows = rowsOf(curve);
  const steps = rows.slice(1).map(([at], place) => at - (rows[place]?.[0] ?? at));
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)] ?? 0;
  return Math.max(5, 3 * (curve.every_s ?? usual), 1.5 * curve.step_s);
}

/** Columns of a plot; where the curve breaks stands a row without values. */
export function bandColumns(
  curve: Curve,
  set: Curve | null,
  gaps: readonly Gap[],
  factor = 1,
): BandColumns {
  const longest = longestStep(curve);
  const columns: BandColumns = [[], [], [], [], []];
  const setRows = set ? rowsOf(set) : [];
  let place = -1;
  const put = (at: number, mean: number | null, low: number | null, high: number | null): void => {
    while ((setRows[place + 1]?.[0] ?? Infinity) <= at) place += 1;
    const wanted = setRows[place]?.[1];
    columns[0].push(at);
    columns[1].push(mean);
    columns[2].push(low);
    columns[3].push(high);
    columns[4].push(wanted === undefined ? null : wanted * factor);
  };
  let before: number | null = null;
  for (const [at, mean, low, high] of rowsOf(curve)) {
    if (before !== null && at > before) {
      const from = before;
      const isLost = gaps.some((gap) => gap.since >= from && gap.until <= at);
      if (isLost || at - from > longest) put((from + at) / 2, null, null, null);
    }
    put(at, mean * factor, low * factor, high * factor);
    before = at;
  }
  return columns;
}

/** Unit and factor in which a person reads large values: 4000 µL is 4 mL. */
export function readableUnit(curve: Curve): [unit: string, factor: number] {
  if (curve.is_share) return ["% yes", 100];
  const scale = { µL: ["mL", 0.001], mg: ["g", 0.001] }[curve.unit] as [string, number] | undefined;
  const isLarge = rowsOf(curve).some(([, , low, high]) => high >= 1000 || low <= -1000);
  return scale && isLarge ? scale : [curve.unit, 1];
}

/** What a gap says to a person. */
export function gapWords(gaps: readonly Gap[]): string {
  if (!gaps.length) return "";
  const lost = gaps.reduce((sum, gap) => sum + (gap.lost_count ?? 0), 0);
  const isKnown = gaps.every((gap) => gap.lost_count !== null);
  const count = gaps.length === 1 ? "1 recorded gap" : `${gaps.length} recorded gaps`;
  if (!isKnown && !lost) return `${count}; how many samples were lost is not known`;
  const samples = lost === 1 ? "1 sample" : `${lost} samples`;
  return `${count}, ${isKnown ? "" : "at least "}${samples} lost`;
}

/** A little air above and below, never a window without height, nor below zero for nothing. */
export function roomy(min: number | null, max: number | null): [number, number] {
  if (min === null || max === null) return [0, 1];
  const span = Math.max(max - min, Math.abs(max) * 0.05, 1);
  const middle = (min + max) / 2;
  const low = middle - span * 0.58;
  const lift = min >= 0 ? Math.max(0, -low - span * 0.08) : 0;
  return [low + lift, middle + span * 0.58 + lift];
}
