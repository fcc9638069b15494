/** Quantities as typed: read, checked against the server's closed list, shown. */

import { THIN } from "./format";
import type { UnitTable } from "./wire";

export type UnitTables = Record<string, UnitTable>;

export interface Quantity {
  number: string;
  unit: string;
}

/** Either the quantity or the sentence that says why the text is none. */
export type Parsed = { ok: true; quantity: Quantity } | { ok: false; reason: string };

const PATTERN = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)?$/;
const COMMA = /^[+-]?\d+,\d/;

/** Spellings of a microlitre: the micro sign and the Greek letter look alike. */
const MICRO = ["u", "\u00b5", "\u03bc"].flatMap((micro) => [`${micro}L`, `${micro}l`]);

function spelled<T>(value: T, suffix = ""): Record<string, T> {
  return Object.fromEntries(MICRO.map((unit) => [unit + suffix, value]));
}

/** Factor and offset to the canonical unit of the dimension. */
const SCALE: Record<string, Record<string, [factor: number, offset: number]>> = {
  volume: {
    L: [1e6, 0],
    l: [1e6, 0],
    mL: [1000, 0],
    ml: [1000, 0],
    ...spelled([1, 0]),
    nL: [1e-3, 0],
    nl: [1e-3, 0],
    cL: [1e4, 0],
    dL: [1e5, 0],
  },
  flow_rate: {
    "mL/min": [1000 / 60, 0],
    "ml/min": [1000 / 60, 0],
    ...spelled([1, 0], "/s"),
    "mL/s": [1000, 0],
    ...spelled([1 / 60, 0], "/min"),
    "uL/h": [1 / 3600, 0],
    "mL/h": [1000 / 3600, 0],
    "L/h": [1e6 / 3600, 0],
    "L/min": [1e6 / 60, 0],
    "L/s": [1e6, 0],
  },
  temperature: { "°C": [1, 0], degC: [1, 0], C: [1, 0], K: [1, -273.15], "°F": [5 / 9, -160 / 9] },
  temperature_difference: { K: [1, 0] },
  time: { ms: [1e-3, 0], s: [1, 0], min: [60, 0], h: [3600, 0], day: [86400, 0] },
  speed: { rpm: [1, 0] },
  pressure: {
    mbar: [0.1, 0],
    kPa: [1, 0],
    bar: [100, 0],
    Torr: [101.325 / 760, 0],
    atm: [101.325, 0],
    Pa: [1e-3, 0],
    hPa: [0.1, 0],
    MPa: [1000, 0],
  },
  mass: { kg: [1e6, 0], g: [1000, 0], mg: [1, 0], ug: [1e-3, 0], µg: [1e-3, 0], μg: [1e-3, 0] },
  ph_difference: { pH: [1, 0] },
  share: { "%": [0.01, 0] },
};

/** How a unit is shown, whichever way it was typed. */
const SHOWN: Record<string, string> = {
  ...spelled("µL"),
  ml: "mL",
  l: "L",
  nl: "nL",
  degC: "°C",
  C: "°C",
  "ml/min": "mL/min",
  ...spelled("µL/s", "/s"),
  ...spelled("µL/min", "/min"),
  "uL/h": "µL/h",
  ug: "µg",
  μg: "µg",
};

/** Read text such as `250 uL`; `fallback` is the unit of a bare number, "" asks for one. */
export function parseQuantity(
  text: string,
  dimension: string,
  tables: UnitTables,
  fallback = "",
): Parsed {
  const table = tables[dimension];
  const example = `5 ${table?.units[0] ?? "mL"}`;
  const clean = text
    .trim()
    .replaceAll("\u2009", " ")
    .replaceAll(THIN, " ")
    .replaceAll("\u2212", "-");
  if (!clean) return { ok: false, reason: `Write number and unit, such as ${example}.` };
  if (COMMA.test(clean)) return { ok: false, reason: "Write a decimal point, not a comma." };
  const match = PATTERN.exec(clean);
  const written = match?.[2]?.trim() ?? fallback;
  const unit = table?.spellings?.[written] ?? written;
  if (!match?.[1] || !unit) {
    return { ok: false, reason: `Write number and unit, such as ${example}.` };
  }
  if (table && !table.units.includes(unit)) {
    const known = [...new Set(table.units.map(showUnit))].join(", ");
    return { ok: false, reason: `${unit} is no unit of ${words(dimension)}: use ${known}.` };
  }
  return { ok: true, quantity: { number: match[1], unit } };
}

/** Number in the canonical unit, or null when the browser does not know the unit. */
export function toCanonical(quantity: Quantity, dimension: string): number | null {
  const scale = SCALE[dimension]?.[quantity.unit];
  return scale ? Number(quantity.number) * scale[0] + scale[1] : null;
}

/** What is stored: the number as typed, a plain space, and the usual spelling of the unit. */
export function storeQuantity(quantity: Quantity, tables: UnitTables, dimension: string): string {
  const shown = showUnit(quantity.unit);
  const unit = tables[dimension]?.units.includes(shown) ? shown : quantity.unit;
  return `${quantity.number} ${unit}`;
}

/** Usual spelling of a unit. */
export function showUnit(unit: string): string {
  return SHOWN[unit] ?? unit;
}

/** A stored quantity with a narrow space, for sentences. */
export function showQuantity(text: string): string {
  const match = PATTERN.exec(text.trim());
  return match?.[1] && match[2] ? `${match[1]}${THIN}${showUnit(match[2].trim())}` : text;
}

/** Reason why a quantity cannot stand in a field, or null. */
export function findQuantityProblem(quantity: Quantity, dimension: string): string | null {
  const value = toCanonical(quantity, dimension) ?? Number(quantity.number);
  if (!Number.isFinite(value)) return "The number is too large.";
  if (dimension === "temperature") return value < -273.15 ? "This is below absolute zero." : null;
  if (dimension === "temperature_difference") return null;
  return value <= 0 ? "Must be more than zero." : null;
}

function words(dimension: string): string {
  return dimension.replaceAll("_", " ");
}
