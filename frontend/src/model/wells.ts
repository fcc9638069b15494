/** The places of a plate, a rack or a reservoir, by row and column. */

import type { ResourceRow } from "./wire";

export interface Well {
  row: ResourceRow;
  /** A1, B12, AF48. */
  address: string;
  /** Something stands in it: a tip in its spot. */
  isTaken: boolean;
}

export interface WellMap {
  letters: string[];
  numbers: number[];
  at: ReadonlyMap<string, Well>;
  /** Materials in it, the most plentiful first, with their amounts. */
  materials: { name: string; amount_nl: number }[];
}

const ADDRESS = /^([A-Z]{1,2})([1-9]\d?)$/;
const FEWEST = 2;

/** Place in the alphabet: A is 0, Z 25, AA 26. */
function rank(letters: string): number {
  return [...letters].reduce((sum, letter) => sum * 26 + letter.charCodeAt(0) - 64, 0) - 1;
}

/** Map of what stands in a resource by address, or null when its children have none. */
export function wellMap(rows: readonly ResourceRow[], id: string): WellMap | null {
  const at = new Map<string, Well>();
  const taken = new Set(rows.map((row) => row.parent_id));
  const letters = new Set<string>();
  const numbers = new Set<number>();
  const amounts = new Map<string, number>();
  for (const row of rows) {
    if (row.parent_id !== id) continue;
    const address = row.key.split("/").at(-1) ?? "";
    const found = ADDRESS.exec(address);
    if (!found) return null;
    letters.add(found[1] ?? "");
    numbers.add(Number(found[2]));
    at.set(address, { row, address, isTaken: taken.has(row.id) });
    for (const { material, amount_nl } of row.contents)
      amounts.set(material, (amounts.get(material) ?? 0) + amount_nl);
  }
  if (at.size < FEWEST) return null;
  return {
    letters: [...letters].sort((a, b) => rank(a) - rank(b)),
    numbers: [...numbers].sort((a, b) => a - b),
    at,
    materials: [...amounts]
      .map(([name, amount_nl]) => ({ name, amount_nl }))
      .sort((a, b) => b.amount_nl - a.amount_nl || a.name.localeCompare(b.name)),
  };
}

/** Parents whose children stand on a map, and so need no rows of their own in the tree. */
export function mappedIds(rows: readonly ResourceRow[], fewest: number): Set<string> {
  const children = new Map<string, number>();
  for (const row of rows)
    if (row.parent_id) children.set(row.parent_id, (children.get(row.parent_id) ?? 0) + 1);
  const many = [...children].filter(([, count]) => count >= fewest).map(([id]) => id);
  return new Set(many.filter((id) => wellMap(rows, id) !== null));
}
