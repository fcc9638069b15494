/** Rules of drivers on trial: what was tried, what crossed the line, what came of a wish. */

import type { State } from "./states";
import type { Tried, Tryout, TryoutAct, TryoutRow } from "./wiretryouts";

const STATE: Record<TryoutRow["state"], State> = {
  starting: { look: "queued", word: "Starts" },
  running: { look: "sim", word: "On trial" },
  ended: { look: "idle", word: "Ended" },
};

export const tryoutState = (row: TryoutRow): State =>
  row.state === "ended" && row.code ? { look: "error", word: "Failed" } : STATE[row.state];

const counted = (count: number, word: string): string =>
  `${count} ${word}${count === 1 ? "" : "s"}`;

/** `6 of 7 actions, 2 faults`; null when nothing was tried. */
export function triedText(tried: Tried): string | null {
  const { actions, left_out, faults, statuses_were_read } = tried;
  const isNothing = !actions.length && !tried.failed.length && !faults.length;
  if (isNothing && !statuses_were_read) return null;
  const all = actions.length + left_out.length;
  const parts = all ? [`${actions.length} of ${counted(all, "action")}`] : [];
  if (statuses_were_read) parts.push("statuses read");
  parts.push(faults.length ? counted(faults.length, "fault") : "no fault");
  return parts.join(", ");
}

const isText = (byte: number): boolean => byte >= 0x20 && byte < 0x7f;

const NAMES: Record<number, string> = { 10: "\\n", 13: "\\r", 9: "\\t" };

/** Bytes as text where nearly all are printable, else as pairs of digits. */
export function wireText(hex: string): string {
  const bytes = (hex.match(/../g) ?? []).map((pair) => parseInt(pair, 16));
  const shown = bytes.filter((byte) => isText(byte) || byte in NAMES).length;
  if (bytes.length === 0 || shown < bytes.length) return hex.replace(/(..)(?=.)/g, "$1 ");
  return bytes.map((byte) => NAMES[byte] ?? String.fromCharCode(byte)).join("");
}

/** The action that runs, if one does. */
export const acting = ({ acts }: Tryout): TryoutAct | undefined =>
  acts.find((act) => act.sort === "act" && act.answered_at === null);

export const isLive = (row: TryoutRow | undefined): boolean =>
  row !== undefined && row.state !== "ended";

/** What came of a wish, in a sentence. */
export function outcomeOf(act: TryoutAct): { look: State["look"]; text: string } {
  if (act.answered_at === null) return { look: "running", text: "under way" };
  if (act.code) return { look: "error", text: act.message || act.code };
  const problems = Object.values((act.data["problems"] ?? {}) as Record<string, string>);
  if (problems.length) return { look: "error", text: problems[0] ?? "" };
  return { look: "ok", text: reportText(act.data) };
}

/** A report's own words: what moved, and what was read as evidence. */
function reportText(data: Record<string, unknown>): string {
  const parts: string[] = [];
  if (typeof data["moved_ul"] === "number") parts.push(`moved ${data["moved_ul"]} µL`);
  const evidence = (data["evidence"] ?? {}) as Record<string, unknown>;
  for (const [name, value] of Object.entries(evidence)) {
    parts.push(`${name} ${typeof value === "object" ? JSON.stringify(value) : String(value)}`);
  }
  return parts.join(", ") || "done";
}

/** Effect on matter of a failure, as the driver says it. */
export const EFFECT: Record<string, string> = {
  none: "nothing moved",
  partial: "a part happened",
  full: "it happened",
  unknown: "nobody knows what moved",
};

/** A fault's name as words. */
export const faultText = (name: string): string => name.replaceAll("_", " ");
