/** The choices about a job that ended undone, and when one can be sent. */

import type { RecoveryCard, RecoveryChoice, RecoveryName } from "./wire";

export const CHOICE_WORDS: Record<RecoveryName, string> = {
  retry: "Try again",
  change: "Change values and plan anew",
  done_by_hand: "Mark as done by hand",
  skip: "Skip",
};

const EQUAL_FAILURES = 2;

/** Choices as they are shown; after two failures trying again is no longer first. */
export function orderedChoices(card: Pick<RecoveryCard, "choices" | "tries">): RecoveryChoice[] {
  const offered = card.choices.filter((one) => one.why_not === null);
  const others = card.choices.filter((one) => one.why_not !== null);
  if (card.tries < EQUAL_FAILURES) return [...offered, ...others];
  const retry = offered.filter((one) => one.name === "retry");
  return [...offered.filter((one) => one.name !== "retry"), ...retry, ...others];
}

interface Draft {
  choice: RecoveryName | null;
  note: string;
  ul: number;
  changed: Record<string, unknown>;
  asked_ul: number | null;
}

/** Why a choice cannot be sent yet; null: it can. */
export function whyNotSend(draft: Draft): string | null {
  if (!draft.choice) return "Choose first.";
  const needsAmount = draft.choice === "done_by_hand" && draft.asked_ul !== null;
  if (needsAmount && !(draft.ul > 0)) return "Write how much you moved, in mL.";
  if (draft.choice === "change" && Object.keys(draft.changed).length === 0)
    return "Change a value first.";
  return draft.note.trim() ? null : "Write why.";
}

/** A changed value in the sort that it had. */
export function readValue(text: string, before: unknown): unknown {
  if (typeof before === "string" || before === undefined || before === null) return text;
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return text;
  }
}
