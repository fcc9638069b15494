/** Taking stock: what was seen, lot by lot, against what is recorded. */

import { formatVolume, splitMass, THIN } from "./format";
import { parseQuantity, toCanonical, type UnitTables } from "./quantity";
import type { Content, StockLot } from "./wirelab";

export const STOCK_UNITS: UnitTables = {
  volume: {
    canonical: "microliter",
    suffix: "ul",
    units: ["mL", "ml", "µL", "uL", "ul", "nL", "L"],
  },
  mass: { canonical: "milligram", suffix: "mg", units: ["mg", "g", "µg", "ug", "kg"] },
};

/** One lot that the vessel holds by the record, or by what somebody saw. */
export interface StockLine {
  lot: StockLot;
  recorded: number;
}

export type Seen = { amount: number; problem: null } | { amount: null; problem: string | null };

export const dimensionOf = (lot: StockLot): "volume" | "mass" =>
  lot.unit === "nl" ? "volume" : "mass";

export const usualUnit = (lot: StockLot): string => (lot.unit === "nl" ? "mL" : "mg");

/** What is recorded, and the lots that somebody added. */
export function stockLines(contents: Content[], added: StockLot[]): StockLine[] {
  const recorded = contents.map(({ lot_id, lot, material, amount_nl, amount_ug }): StockLine => {
    const isSolid = amount_nl === 0 && amount_ug !== 0;
    return {
      lot: { lot_id, lot, material, unit: isSolid ? "ug" : "nl" },
      recorded: isSolid ? amount_ug : amount_nl,
    };
  });
  return [...recorded, ...added.map((lot) => ({ lot, recorded: 0 }))];
}

/** Whole nanolitres or micrograms, or why the text is no amount; nothing written is no problem. */
export function readSeen(text: string, lot: StockLot): Seen {
  if (!text.trim()) return { amount: null, problem: null };
  const dimension = dimensionOf(lot);
  const parsed = parseQuantity(text, dimension, STOCK_UNITS, usualUnit(lot));
  if (!parsed.ok) return { amount: null, problem: parsed.reason };
  const value = toCanonical(parsed.quantity, dimension);
  if (value === null || !Number.isFinite(value)) return { amount: null, problem: "No amount." };
  if (value < 0) return { amount: null, problem: "Cannot be less than nothing." };
  const amount = Math.round(value * 1000);
  if (!Number.isSafeInteger(amount)) return { amount: null, problem: "The number is too large." };
  return { amount, problem: null };
}

export function formatAmount(amount: number, lot: StockLot): string {
  return lot.unit === "nl" ? formatVolume(amount) : splitMass(amount).join(THIN);
}

/** What the difference of one line does to the ledger. */
export function effectOf(line: StockLine, amount: number, account: string): string {
  const change = amount - line.recorded;
  const name = `${line.lot.material} ${line.lot.lot}`;
  if (change === 0) return `${name}: stays at ${formatAmount(amount, line.lot)}`;
  const by = formatAmount(Math.abs(change), line.lot);
  const way = change > 0 ? "comes out of" : "goes to";
  return `${name}: ${formatAmount(amount, line.lot)}; ${by} ${way} ${account}`;
}

export interface Correction {
  op: "correct";
  resource_id: string;
  account: string;
  reason: string;
  measured_nl: Record<string, number>;
  measured_ug: Record<string, number>;
}

/** The operation, or null while something was not looked at. */
export function correctionOf(
  resourceId: string,
  lines: StockLine[],
  seen: Record<string, string>,
  account: string,
  reason: string,
): Correction | null {
  const found: Correction = {
    op: "correct",
    resource_id: resourceId,
    account,
    reason: reason.trim(),
    measured_nl: {},
    measured_ug: {},
  };
  for (const { lot } of lines) {
    const { amount } = readSeen(seen[lot.lot_id] ?? "", lot);
    if (amount === null) return null;
    if (amount > 0) found[lot.unit === "nl" ? "measured_nl" : "measured_ug"][lot.lot_id] = amount;
  }
  return found;
}
