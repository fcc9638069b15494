/** What the form of a temperature calibration asks for, and the order that it makes. */

import { readNumber } from "./calibration";
import type { TemperatureOrder } from "./wirecalibration";

export interface HeatDraft {
  vessel_id: string;
  thermometer_id: string;
  certificate: string;
  expanded: string;
  due_on: string;
  set_points: string;
  settle_min: string;
  repeats: string;
  stir_rpm: string;
  tolerance: string;
  valid_days: string;
}

export const EMPTY_HEAT: HeatDraft = {
  vessel_id: "",
  thermometer_id: "",
  certificate: "",
  expanded: "",
  due_on: "",
  set_points: "",
  settle_min: "5",
  repeats: "3",
  stir_rpm: "",
  tolerance: "0.5",
  valid_days: "365",
};

const LEAST_SET_POINTS = 3;

const NUMBERS: [keyof HeatDraft, string][] = [
  ["expanded", "the uncertainty of the thermometer"],
  ["settle_min", "how long each set point is held"],
  ["repeats", "how often each is read"],
  ["tolerance", "the uncertainty that is wanted"],
  ["valid_days", "for how many days it shall hold"],
];

/** 30, 55, 80: with commas or spaces between. */
export function setPointsOf(text: string): number[] {
  return text
    .split(/[\s,;]+/)
    .filter(Boolean)
    .map(readNumber);
}

/** The first thing that is missing; null: the server can be asked. */
export function whyNoHeatOrder(draft: HeatDraft): string | null {
  if (!draft.vessel_id) return "Choose the vessel that is heated.";
  if (!draft.thermometer_id) return "Choose the reference thermometer.";
  if (!draft.certificate.trim()) return "Write the number of the thermometer’s certificate.";
  if (!/^\d{4}-\d\d-\d\d$/.test(draft.due_on)) return "Write until when the certificate holds.";
  const points = setPointsOf(draft.set_points);
  if (points.length < LEAST_SET_POINTS || !points.every(Number.isFinite)) {
    return "Write three set points or more, such as 30, 55, 80.";
  }
  const missing = NUMBERS.find(([name]) => !Number.isFinite(readNumber(draft[name])));
  if (missing) return `Write ${missing[1]} as a number.`;
  const isStirred = draft.stir_rpm.trim() !== "";
  return isStirred && !Number.isFinite(readNumber(draft.stir_rpm))
    ? "Write how fast it is stirred as a number, or leave it empty."
    : null;
}

/** The order as the server takes it. */
export function heatOrderOf(draft: HeatDraft, thermometer: string): TemperatureOrder {
  return {
    vessel_id: draft.vessel_id,
    thermometer_id: draft.thermometer_id,
    reference: {
      name: thermometer,
      certificate: draft.certificate.trim(),
      expanded: readNumber(draft.expanded),
      due_on: draft.due_on,
    },
    set_points_c: setPointsOf(draft.set_points),
    settle_s: readNumber(draft.settle_min) * 60,
    repeats: readNumber(draft.repeats),
    stir_speed_rpm: draft.stir_rpm.trim() ? readNumber(draft.stir_rpm) : null,
    tolerance: readNumber(draft.tolerance),
    valid_days: readNumber(draft.valid_days),
  };
}
