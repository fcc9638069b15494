/** The resource tree: which rows show, what may stand in a field. */

import type { ResourceRow, Schema } from "./wire";

/** Rows in tree order whose ancestors are all open, or that match what is looked for. */
export function visibleRows(
  rows: readonly ResourceRow[],
  closed: ReadonlySet<string>,
  query: string,
): ResourceRow[] {
  const wanted = query.trim().toLowerCase();
  if (wanted) {
    const kept = new Set<string>();
    const byId = new Map(rows.map((row) => [row.id, row]));
    for (const row of rows) {
      if (!matches(row, wanted)) continue;
      for (let at: ResourceRow | undefined = row; at; at = byId.get(at.parent_id ?? ""))
        kept.add(at.id);
    }
    return rows.filter((row) => kept.has(row.id));
  }
  const hidden = new Set<string>();
  return rows.filter((row) => {
    const parent = row.parent_id ?? "";
    if (hidden.has(parent) || closed.has(parent)) {
      hidden.add(row.id);
      return false;
    }
    return true;
  });
}

function matches(row: ResourceRow, wanted: string): boolean {
  const lots = row.contents.flatMap((content) => [content.lot, content.material]);
  return [row.name, row.key, row.kind_label, ...lots].some((t) => t.toLowerCase().includes(wanted));
}

export function parentIds(rows: readonly ResourceRow[]): Set<string> {
  return new Set(rows.flatMap((row) => (row.parent_id ? [row.parent_id] : [])));
}

/** Resources that may stand in a field, by its `x-resource`. */
export function findChoices(
  rows: readonly ResourceRow[],
  wants: NonNullable<Schema["x-resource"]>,
): ResourceRow[] {
  return rows.filter((row) => {
    if (row.is_archived) return false;
    if (wants.kind && !wants.kind.includes(row.kind)) return false;
    if (wants.holds === "liquid" && (!row.holds_liquid || row.kind === "syringe_pump"))
      return false;
    if (wants.acts && !row.device) return false;
    return true;
  });
}

/** How full, 0 to 1; null when nobody stated the capacity. */
export function fillShare(row: Pick<ResourceRow, "volume_nl" | "capacity_nl">): number | null {
  return row.capacity_nl ? Math.min(1, row.volume_nl / row.capacity_nl) : null;
}
