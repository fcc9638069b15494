/** Series of a device: readings with their setpoints, gaps as gaps. */

import type { Sample } from "./wire";

export type Points = [at_s: number, value: number][];

export interface Channel {
  status: string;
  label: string;
  unit: string;
  points: Points;
  setpoints: Points;
}

const SETPOINT = /_?setpoint/;

export const isSetpoint = (status: string): boolean => SETPOINT.test(status);

interface Named {
  name: string;
  label: string;
  unit: string;
}

/** Two temperatures of one heater are told apart: what it controls, and its plate. */
export function labelOf(
  status: string,
  label: string | undefined,
  others: readonly string[],
): string {
  if (status === "temperature_c" && others.includes("plate_temperature_c"))
    return "Controlled temperature";
  return label ?? status.replaceAll("_", " ");
}

/** Pair each measured series with its setpoint, what is controlled first; text and yes-or-no are no curves. */
export function pairSeries(
  series: Readonly<Record<string, readonly (readonly [number, unknown])[]>>,
  statuses: readonly Named[],
): Channel[] {
  const named = new Map(statuses.map((status) => [status.name, status]));
  const numbers = (status: string): Points =>
    (series[status] ?? []).flatMap(([at, value]): Points =>
      typeof value === "number" ? [[at, value]] : [],
    );
  return Object.keys(series)
    .filter((status) => !isSetpoint(status) && numbers(status).length > 0)
    .map((status) => {
      const setpoint = Object.keys(series).find(
        (other) => isSetpoint(other) && other.replace(SETPOINT, "") === status,
      );
      return {
        status,
        label: labelOf(status, named.get(status)?.label, Object.keys(series)),
        unit: named.get(status)?.unit ?? "",
        points: numbers(status),
        setpoints: setpoint ? numbers(setpoint) : [],
      };
    })
    .sort((a, b) => Number(b.setpoints.length > 0) - Number(a.setpoints.length > 0));
}

const SCALES: Readonly<Record<string, readonly [unit: string, factor: number]>> = {
  µL: ["mL", 0.001],
  mg: ["g", 0.001],
};

/** Channel in the unit a person reads, once its values are large: 4000 µL is 4 mL. */
export function readable(channel: Channel): Channel {
  const scale = SCALES[channel.unit];
  if (!scale || !channel.points.some(([, value]) => Math.abs(value) >= 1000)) return channel;
  const [unit, factor] = scale;
  const scaled = (points: Points): Points => points.map(([at, value]) => [at, value * factor]);
  return { ...channel, unit, points: scaled(channel.points), setpoints: scaled(channel.setpoints) };
}

/** Add live samples to fetched series; old ones beyond `keep_s` are let go. */
export function appendSamples(
  series: Readonly<Record<string, readonly (readonly [number, unknown])[]>>,
  samples: readonly Sample[],
  keep_s: number,
): Record<string, (readonly [number, unknown])[]> {
  const next: Record<string, (readonly [number, unknown])[]> = {};
  const newest = Math.max(0, ...samples.map(([, at]) => at));
  for (const [status, points] of Object.entries(series)) {
    next[status] = points.filter(([at]) => at >= newest - keep_s);
  }
  for (const [status, at, value] of samples) {
    const points = (next[status] ??= []);
    const last = points.at(-1);
    if (!last || at > last[0]) points.push([at, value]);
  }
  return next;
}

/** Columns for a plot: times, readings with null where the stream broke, setpoints held. */
export function plotColumns(channel: Channel): [number[], (number | null)[], (number | null)[]] {
  const gap = longestStep(channel.points);
  const times = new Set<number>();
  const breaks = new Set<number>();
  channel.points.forEach(([at], place) => {
    const before = channel.points[place - 1];
    if (before && at - before[0] > gap) {
      const middle = (at + before[0]) / 2;
      times.add(middle);
      breaks.add(middle);
    }
    times.add(at);
  });
  for (const [at] of channel.setpoints) times.add(at);
  const xs = [...times].sort((a, b) => a - b);
  const measured = new Map(channel.points);
  return [xs, interpolate(xs, measured, breaks), hold(xs, channel.setpoints)];
}

/** More than three usual periods, and at least five seconds, is a gap. */
function longestStep(points: Points): number {
  const steps = points.slice(1).map(([at], place) => at - (points[place]?.[0] ?? at));
  if (!steps.length) return Infinity;
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)] ?? 0;
  return Math.max(5, usual * 3);
}

function interpolate(
  xs: number[],
  measured: ReadonlyMap<number, number>,
  breaks: ReadonlySet<number>,
): (number | null)[] {
  let last: number | null = null;
  return xs.map((x) => {
    if (breaks.has(x)) last = null;
    else last = measured.get(x) ?? last;
    return last;
  });
}

function hold(xs: number[], setpoints: Points): (number | null)[] {
  let place = -1;
  return xs.map((x) => {
    while ((setpoints[place + 1]?.[0] ?? Infinity) <= x) place += 1;
    return setpoints[place]?.[1] ?? null;
  });
}
