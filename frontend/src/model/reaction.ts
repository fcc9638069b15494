/** A reaction as it is told: what each lot gave, what came of it, and whether the masses agree. */

import { readSeen, type Seen } from "./stock";
import type { ReactionLot, ReactionMaterial, ReactionStock } from "./wirelab";

export type Phase = "liquid" | "solid" | "gas";

export interface ReactionDraft {
  consumed: Record<string, string>;
  /** Weighed, for liquids of unknown density; the key `product` is the product's. */
  weighed: Record<string, string>;
  materialId: string | null;
  phase: Phase;
  amount: string;
  key: string;
  reason: string;
}

export const EMPTY_REACTION: ReactionDraft = {
  consumed: {},
  weighed: {},
  materialId: null,
  phase: "solid",
  amount: "",
  key: "",
  reason: "",
};

export const PRODUCT = "product";

const unitOf = (phase: Phase): "nl" | "ug" => (phase === "liquid" ? "nl" : "ug");

/** The product as a line of the form. */
export const productLot = (phase: Phase): ReactionLot => ({
  lot_id: PRODUCT,
  lot: "",
  material: "",
  unit: unitOf(phase),
  amount: 0,
  density_mg_ul: null,
});

const MASS_LOT = { lot_id: "", lot: "", material: "", unit: "ug" } as const;

export const readMass = (text: string): Seen => readSeen(text, MASS_LOT);

/** Whole micrograms of an amount; null: nobody can tell. A density in mg/µL is one in µg/nL. */
export function massOf(
  amount: number,
  unit: "nl" | "ug",
  density: number | null,
  weighed: string,
): number | null {
  if (unit === "ug") return amount;
  if (density !== null) return Math.round(amount * density);
  return readMass(weighed).amount;
}

export interface Share {
  lot: ReactionLot;
  amount: number;
  mass: number | null;
}

/** What lots gave; a line that is left empty gave nothing. */
export function shares(stock: ReactionStock, draft: ReactionDraft): Share[] {
  return stock.lots.flatMap((lot): Share[] => {
    const { amount } = readSeen(draft.consumed[lot.lot_id] ?? "", lot);
    if (!amount) return [];
    const weighed = draft.weighed[lot.lot_id] ?? "";
    return [{ lot, amount, mass: massOf(amount, lot.unit, lot.density_mg_ul, weighed) }];
  });
}

export interface MassBalance {
  consumed: number | null;
  made: number | null;
  /** What is left over stays in REACTION; below zero more was made than consumed. */
  residue: number | null;
}

export function massBalance(stock: ReactionStock, draft: ReactionDraft): MassBalance {
  const given = shares(stock, draft);
  const isKnown = given.length > 0 && given.every((share) => share.mass !== null);
  const consumed = isKnown ? given.reduce((sum, share) => sum + (share.mass ?? 0), 0) : null;
  const { amount } = readSeen(draft.amount, productLot(draft.phase));
  const density = material(stock, draft)?.density_mg_ul ?? null;
  const weighed = draft.weighed[PRODUCT] ?? "";
  const made = amount ? massOf(amount, unitOf(draft.phase), density, weighed) : null;
  return { consumed, made, residue: consumed === null || made === null ? null : consumed - made };
}

const material = (stock: ReactionStock, draft: ReactionDraft): ReactionMaterial | undefined =>
  stock.materials.find((one) => one.id === draft.materialId);

/** Why it cannot be sent yet; null: it can. */
export function whyNotReacted(stock: ReactionStock, draft: ReactionDraft): string | null {
  const given = shares(stock, draft);
  if (!given.length) return "Write what was consumed of at least one lot.";
  const over = given.find((share) => share.amount > share.lot.amount);
  if (over) return `There is less of ${over.lot.material} than that.`;
  if (!draft.materialId) return "Say which material was made.";
  if (!readSeen(draft.amount, productLot(draft.phase)).amount) return "Write how much was made.";
  if (!draft.key.trim()) return "Give the product a name of its own.";
  const { consumed, made, residue } = massBalance(stock, draft);
  if (consumed === null || made === null)
    return "Give the mass of each liquid whose density nobody stated.";
  if (residue !== null && residue < 0) return "More mass was made than was consumed.";
  if (!draft.reason.trim()) return "Write how it is known what was made.";
  return null;
}

/** The operation as the server takes it; null while something is missing. */
export function reactionOf(
  resourceId: string,
  stock: ReactionStock,
  draft: ReactionDraft,
  newLotId: string,
): Record<string, unknown> | null {
  if (whyNotReacted(stock, draft) !== null) return null;
  const amount = readSeen(draft.amount, productLot(draft.phase)).amount ?? 0;
  const unit = unitOf(draft.phase);
  const mass = readMass(draft.weighed[PRODUCT] ?? "").amount;
  return {
    op: "react",
    resource_id: resourceId,
    reactants: shares(stock, draft).map(({ lot, amount: gave }) => ({
      lot_id: lot.lot_id,
      [`amount_${lot.unit}`]: gave,
      ...weighedField(lot.unit, lot.density_mg_ul, draft.weighed[lot.lot_id] ?? ""),
    })),
    products: [
      {
        lot_id: newLotId,
        material_id: draft.materialId,
        key: draft.key.trim(),
        phase: draft.phase,
        [`amount_${unit}`]: amount,
        ...(unit === "nl" && mass !== null ? { mass_ug: mass } : {}),
      },
    ],
    residue_ug: massBalance(stock, draft).residue ?? 0,
    reason: draft.reason.trim(),
  };
}

function weighedField(
  unit: "nl" | "ug",
  density: number | null,
  text: string,
): { mass_ug?: number } {
  const mass = unit === "nl" && density === null ? readMass(text).amount : null;
  return mass === null ? {} : { mass_ug: mass };
}

/** An id that nobody has, also where the page came without TLS. */
export function newId(random: Uint8Array): string {
  const bytes = Uint8Array.from(random.slice(0, 16));
  bytes[6] = ((bytes[6] ?? 0) & 0x0f) | 0x40;
  bytes[8] = ((bytes[8] ?? 0) & 0x3f) | 0x80;
  const hex = [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  return hex.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5");
}
