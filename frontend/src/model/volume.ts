/** A volume as a person types it about something that was moved. */

import { parseQuantity, toCanonical, type UnitTables } from "./quantity";

const VOLUME: UnitTables = {
  volume: { canonical: "microliter", suffix: "ul", units: ["mL", "ml", "µL", "uL", "ul", "L"] },
};
const LEAST_UL = 0.001;
const MOST_UL = 1e9;

export interface Typed {
  /** Microlitres; null while the text is no volume. */
  ul: number | null;
  problem: string | null;
}

/** Read an amount, in millilitres where no unit stands; empty text is no problem yet. */
export function readVolume(text: string, isZeroAmount = false): Typed {
  if (!text.trim()) return { ul: null, problem: null };
  const parsed = parseQuantity(text, "volume", VOLUME, "mL");
  if (!parsed.ok) return { ul: null, problem: parsed.reason };
  const ul = toCanonical(parsed.quantity, "volume");
  if (ul === null || ul < 0 || (ul === 0 && !isZeroAmount))
    return {
      ul: null,
      problem: isZeroAmount ? "Must not be negative." : "Must be more than zero.",
    };
  if (ul !== 0 && ul < LEAST_UL)
    return { ul: null, problem: "Less than a nanolitre is not recorded." };
  if (ul >= MOST_UL) return { ul: null, problem: "A cubic metre or more cannot have moved." };
  return { ul, problem: null };
}
