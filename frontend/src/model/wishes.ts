/** What is said beside a recipe: what a value may be, and what is wrong with the one given. */

import type { RecipeFinding, RecipeParameter } from "./wirerecipe";

/** What is in a vessel of the graph already, as a person writes it. */
export interface Held {
  vessel: string;
  reagent: string;
  volume: string;
}

/** What a person says beside the recipe, but for its vessels and flasks. */
export interface Wishes {
  parameters: Record<string, string>;
  equiv_reference: string;
  equiv_amount: string;
  rinse: string[];
  /** Whether tubes are filled before the first delivery, and pushed out after each. */
  primes: boolean;
}

interface Said {
  wishes: Wishes;
  held: readonly Held[];
}

const SORTS: Record<string, string> = {
  amount: "an amount with its unit, such as 5 g, 2 mmol or 3 mL",
  count: "a whole number",
  bool: "true or false",
  text: "a text",
};

export const blankHeld: Held = { vessel: "", reagent: "", volume: "" };

/** What a parameter takes, its limits, and its value when nobody says another. */
export function limitsOf({ sort, value, least, most }: RecipeParameter): string {
  const limits =
    least && most
      ? `${least} to ${most}`
      : least
        ? `at least ${least}`
        : most
          ? `at most ${most}`
          : "";
  const parts = [
    SORTS[sort] ?? "",
    limits,
    value ? `${value} unless you say otherwise` : "has no value yet",
  ];
  const told = parts.filter(Boolean).join("; ");
  return `${told.charAt(0).toUpperCase()}${told.slice(1)}.`;
}

/** What is wrong with the value of a parameter, or null. */
export function parameterError(id: string, findings: readonly RecipeFinding[]): string | null {
  return findings.find((finding) => finding.context.parameter === id)?.message ?? null;
}

/** What is wrong with what a vessel is said to hold, or null. */
export function heldError(row: Held, findings: readonly RecipeFinding[]): string | null {
  const found = findings.find(
    ({ context }) => context.vessel === row.vessel && context.reagent === row.reagent,
  );
  return row.vessel && found?.about === "wish" ? found.message : null;
}

/** Whether something else is said than before, blanks and empty rows aside. */
export function changed(before: Said, after: Said): boolean {
  return JSON.stringify(plain(before)) !== JSON.stringify(plain(after));
}

function plain({ wishes, held }: Said): unknown {
  const parameters = Object.entries(wishes.parameters).sort(([a], [b]) => (a < b ? -1 : 1));
  const rows = held.filter((row) => row.vessel || row.reagent || row.volume);
  return [
    parameters,
    wishes.equiv_reference,
    wishes.equiv_amount,
    wishes.rinse,
    wishes.primes,
    rows,
  ];
}
