/** What a calibration says, in numbers and words a person reads. */

import { formatNumber, THIN } from "./format";
import type { State } from "./states";
import type { CalibratedQuantity, Calibration, VolumeOrder } from "./wirecalibration";

export type Kind = Pick<CalibratedQuantity, "is_relative" | "unit">;

const STANDINGS: Record<string, State> = {
  in_force: { look: "ok", word: "In force" },
  expired: { look: "needs", word: "Expired" },
  changed: { look: "needs", word: "Does not hold" },
  withdrawn: { look: "stopped", word: "Withdrawn" },
};

const STATES: Record<string, State> = {
  measuring: { look: "running", word: "Measuring" },
  failed: { look: "error", word: "No result" },
  awaiting: { look: "needs", word: "Awaits a second person" },
  accepted: { look: "ok", word: "Accepted" },
  rejected: { look: "stopped", word: "Rejected" },
  withdrawn: { look: "stopped", word: "Withdrawn" },
};

/** A result that nobody accepts as it is. */
const UNSOUND: State = { look: "error", word: "Does not pass" };

/** The chip of one version; one that a newer version took the place of is idle. */
export function calibrationState(row: Calibration, isNewest: boolean): State {
  if (row.state === "accepted" && !isNewest) return { look: "idle", word: "Superseded" };
  if (row.state === "awaiting" && row.findings.length) return UNSOUND;
  const found = row.standing === null ? STATES[row.state] : STANDINGS[row.standing];
  return found ?? { look: "idle", word: row.state };
}

/** 0.21 %, or 0.05 pH. */
export function amountText(value: number, kind: Kind, decimals = 2): string {
  return kind.is_relative
    ? `${formatNumber(value * 100, decimals)}${THIN}%`
    : `${formatNumber(value, decimals)}${THIN}${kind.unit}`;
}

/** The same with its sign: +0.21 %. What rounds to nothing has none. */
export function signedText(value: number, kind: Kind, decimals = 2): string {
  const text = amountText(value, kind, decimals);
  return value > 0 && /[1-9]/.test(text) ? `+${text}` : text;
}

export interface LevelRow {
  level: number;
  /** As found: how far the true value was from what was asked, as a share or in the unit. */
  found: number;
  left: number;
  expanded: number;
  count: number;
}

export function levelRows(row: Calibration, kind: Kind): LevelRow[] {
  return (row.result?.levels ?? []).map((one) => {
    const per = kind.is_relative ? one.reference : 1;
    return {
      level: one.level,
      found: -one.error / (kind.is_relative ? one.indicated : 1),
      left: one.residual / per,
      expanded: one.expanded / per,
      count: one.count,
    };
  });
}

/** Largest expanded uncertainty of its levels; null without a result. */
export function worst(row: Calibration, kind: Kind): number | null {
  const rows = levelRows(row, kind);
  return rows.length ? Math.max(...rows.map((one) => one.expanded)) : null;
}

export interface Dot {
  /** Place in the plot, 0 to 1 from the left and from the top. */
  x: number;
  y: number;
  value: number;
  residual: number;
}

export interface ResidualPlot {
  dots: Dot[];
  /** Half of its height, as a share or in the unit. */
  reach: number;
  /** Where the lines of the tolerance lie, 0 to 1 from the top. */
  limits: [upper: number, lower: number];
  /** Where the plot begins and ends: at nothing, or at what is below it, and the largest value. */
  start: number;
  end: number;
}

/** What is left of each point after the correction, over the true value. */
export function residualPlot(row: Calibration, kind: Kind): ResidualPlot | null {
  const { result, points, tolerance } = row;
  if (!result || !points.length) return null;
  const left = points.map((point) => {
    const residual = result.offset + result.gain * point.indicated - point.reference;
    return {
      value: point.reference,
      residual: kind.is_relative ? residual / point.reference : residual,
    };
  });
  const reach = 1.2 * Math.max(tolerance, ...left.map((one) => Math.abs(one.residual)));
  const end = Math.max(...left.map((one) => one.value));
  const start = Math.min(0, ...left.map((one) => one.value));
  const place = (value: number): number => 0.5 - value / reach / 2;
  const dots = left.map((one) => ({
    ...one,
    x: (one.value - start) / ((end - start) * 1.04),
    y: place(one.residual),
  }));
  return { dots, reach, limits: [place(tolerance), place(-tolerance)], start, end };
}

/** Whole days until the due date, negative when it is past. */
export function daysLeft(expiresAt: string, now_s: number): number {
  return Math.floor((Date.parse(expiresAt) / 1000 - now_s) / 86_400);
}

export function dueWords(days: number): string {
  if (days < 0) return days === -1 ? "since yesterday" : `${-days} days ago`;
  return days === 0 ? "today" : days === 1 ? "tomorrow" : `in ${days} days`;
}

export interface Draft {
  source_id: string;
  target_id: string;
  balance_id: string;
  water_c: string;
  pressure_kpa: string;
  humidity: string;
  certificate: string;
  expanded: string;
  due_on: string;
  repeats: string;
  tolerance: string;
  valid_days: string;
}

export const EMPTY: Draft = {
  source_id: "",
  target_id: "",
  balance_id: "",
  water_c: "",
  pressure_kpa: "",
  humidity: "50",
  certificate: "",
  expanded: "",
  due_on: "",
  repeats: "3",
  tolerance: "0.5",
  valid_days: "365",
};

const NUMBERS: [keyof Draft, string][] = [
  ["water_c", "the temperature of the water"],
  ["pressure_kpa", "the pressure of the air"],
  ["humidity", "the humidity of the air"],
  ["expanded", "the uncertainty of the balance"],
  ["repeats", "how often each volume is weighed"],
  ["tolerance", "the uncertainty that is wanted"],
  ["valid_days", "for how many days it shall hold"],
];

/** The first thing that is missing; null: the server can be asked. */
export function whyNoOrder(draft: Draft): string | null {
  if (!draft.source_id) return "Choose the vessel with water.";
  if (!draft.balance_id) return "Choose the balance.";
  if (!draft.target_id) return "Choose the vessel on the balance.";
  if (!draft.certificate.trim()) return "Write the number of the balance's certificate.";
  if (!/^\d{4}-\d\d-\d\d$/.test(draft.due_on)) return "Write until when the certificate holds.";
  const missing = NUMBERS.find(([name]) => !Number.isFinite(readNumber(draft[name])));
  return missing ? `Write ${missing[1]} as a number.` : null;
}

export function readNumber(text: string): number {
  return text.trim() ? Number(text.trim()) : NaN;
}

/** The order as the server takes it. */
export function orderOf(draft: Draft, balance: string): VolumeOrder {
  return {
    source_id: draft.source_id,
    target_id: draft.target_id,
    balance_id: draft.balance_id,
    around: {
      water_c: readNumber(draft.water_c),
      pressure_kpa: readNumber(draft.pressure_kpa),
      humidity_ratio: readNumber(draft.humidity) / 100,
    },
    reference: {
      name: balance,
      certificate: draft.certificate.trim(),
      expanded: readNumber(draft.expanded),
      due_on: draft.due_on,
    },
    repeats: readNumber(draft.repeats),
    tolerance: readNumber(draft.tolerance) / 100,
    valid_days: readNumber(draft.valid_days),
  };
}
