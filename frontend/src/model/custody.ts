/** In whose hands a vessel is, and how far it is on its way to another edge host. */

import type { Custody, ResourceRow } from "./wire";

export type MoveStep = "asked" | "released" | "told";

/** What has happened of a move, and what is waited for. */
export function stepOf(move: NonNullable<Custody["move"]>): MoveStep {
  if (move.state !== "in_transit") return "asked";
  return move.is_told ? "told" : "released";
}

/** Where it is now, in one sentence. */
export function whereText(move: NonNullable<Custody["move"]>): string {
  const from = move.from?.name ?? "its host";
  const to = move.to?.name ?? "another host";
  const place = move.place?.name ?? "its place";
  switch (stepOf(move)) {
    case "asked":
      return `It stays in the hands of ${from} until ${from} says that it lets it go to ${place} at ${to}.`;
    case "released":
      return `It is nobody’s. Carry it to ${place}, then say that it is there: ${to} takes it over.`;
    case "told":
      return `${to} was told that it is at ${place}, and has not answered yet.`;
  }
}

/** Why what is connected cannot be carried, connection by connection. */
export function connectedText(connections: Custody["connections"]): string {
  const named = connections.map(({ key, medium, to }) =>
    to ? `${to} (${medium}, ${key})` : `something you may not see (${medium})`,
  );
  return `It is connected to ${named.join(", ")}, and cannot be carried.`;
}

/**
 * Places of a kind that takes a vessel: no part of itself, and not where it stands. Those that have
 * room come first, the others with the reason why not.
 */
export function placesFor(
  resource: Pick<ResourceRow, "id" | "parent_id">,
  rows: readonly ResourceRow[],
  places: Custody["places"],
): { row: ResourceRow; whyNot: string | null }[] {
  const known = new Map(places.map((place) => [place.id, place.why_not]));
  const parents = new Map(rows.map((row) => [row.id, row.parent_id]));
  const isInside = (id: string): boolean => {
    for (let at: string | null = id; at !== null; at = parents.get(at) ?? null) {
      if (at === resource.id) return true;
    }
    return false;
  };
  return rows
    .filter((row) => known.has(row.id) && row.id !== resource.parent_id && !isInside(row.id))
    .map((row) => ({ row, whyNot: known.get(row.id) ?? null }))
    .sort((a, b) => Number(a.whyNot !== null) - Number(b.whyNot !== null));
}
