/** What the form of a pH calibration asks for, and the order that it makes. */

import { readNumber } from "./calibration";
import type { PhOrder } from "./wirecalibration";

export interface BufferDraft {
  source_id: string;
  standard: string;
  lot: string;
  expanded: string;
  due_on: string;
}

export interface PhDraft {
  buffers: BufferDraft[];
  pump_id: string;
  vessel_id: string;
  waste_id: string;
  volume_ml: string;
  repeats: string;
  tolerance: string;
  valid_days: string;
}

/** Standard buffers by the key that the server knows them by. */
export const STANDARDS = [
  { value: "phthalate", label: "Phthalate, pH 4.01" },
  { value: "phosphate", label: "Phosphate, pH 6.86" },
  { value: "borax", label: "Borax, pH 9.18" },
  { value: "carbonate", label: "Carbonate, pH 10.01" },
] as const;

const NO_BUFFER: BufferDraft = { source_id: "", standard: "", lot: "", expanded: "", due_on: "" };

export const EMPTY_PH: PhDraft = {
  buffers: [NO_BUFFER, NO_BUFFER, NO_BUFFER],
  pump_id: "",
  vessel_id: "",
  waste_id: "",
  volume_ml: "",
  repeats: "3",
  tolerance: "0.1",
  valid_days: "7",
};

const isBegun = (one: BufferDraft): boolean => Object.values(one).some(Boolean);

/** The first thing that is missing; null: the server can be asked. */
export function whyNoPhOrder(draft: PhDraft): string | null {
  if (!draft.pump_id) return "Choose the pump.";
  if (!draft.vessel_id) return "Choose the vessel that the probe dips into.";
  if (!draft.waste_id) return "Choose where the buffers go.";
  const named = draft.buffers.filter((one, place) => place < 2 || isBegun(one));
  const bad = named.findIndex(
    (one) =>
      !one.source_id ||
      !one.standard ||
      !one.lot.trim() ||
      !Number.isFinite(readNumber(one.expanded)) ||
      !/^\d{4}-\d\d-\d\d$/.test(one.due_on),
  );
  if (bad >= 0) return `Say all of buffer ${bad + 1}: vessel, standard, lot, uncertainty, date.`;
  const numbers = [draft.volume_ml, draft.repeats, draft.tolerance, draft.valid_days];
  return numbers.every((text) => Number.isFinite(readNumber(text)))
    ? null
    : "Write filling, readings, uncertainty and days as numbers.";
}

/** The order as the server takes it. */
export function phOrderOf(draft: PhDraft): PhOrder {
  return {
    buffers: draft.buffers.filter(isBegun).map((one) => ({
      source_id: one.source_id,
      standard: one.standard,
      reference: {
        name: STANDARDS.find((known) => known.value === one.standard)?.label ?? one.standard,
        certificate: one.lot.trim(),
        expanded: readNumber(one.expanded),
        due_on: one.due_on,
      },
    })),
    vessel_id: draft.vessel_id,
    waste_id: draft.waste_id,
    pump_id: draft.pump_id,
    volume_ul: readNumber(draft.volume_ml) * 1000,
    repeats: readNumber(draft.repeats),
    tolerance: readNumber(draft.tolerance),
    valid_days: readNumber(draft.valid_days),
  };
}
