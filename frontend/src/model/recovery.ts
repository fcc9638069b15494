/** The choices about a job that ended undone, and when one can be sent. */

import { isFinalJob } from "./states";
import type { Job, RecoveryCard, RecoveryChoice, RecoveryName, Run } from "./wire";

/** What a person may do about it: decide about the action, or end the whole run. */
export type RecoveryAct = RecoveryName | "abort";

export const CHOICE_WORDS: Record<RecoveryAct, string> = {
  retry: "Try again",
  change: "Change values and plan anew",
  done_by_hand: "Mark as done by hand",
  skip: "Skip",
  abort: "Abort the run",
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
  choice: RecoveryAct | null;
  note: string;
  ul: number | null;
  changed: Record<string, unknown>;
  asked_ul: number | null;
}

/** Why a choice cannot be sent yet; null: it can. */
export function whyNotSend(draft: Draft): string | null {
  if (!draft.choice) return "Choose first.";
  const needsAmount = draft.choice === "done_by_hand" && draft.asked_ul !== null;
  if (needsAmount && draft.ul === null) return "Write how much you moved.";
  if (draft.choice === "change" && Object.keys(draft.changed).length === 0)
    return "Change a value first.";
  return draft.note.trim() ? null : "Write why.";
}

/** Whether nothing is left of a run after a choice: it then ends, and nobody resumes it. */
export function endsRun(
  run: Pick<Run, "jobs">,
  job: Pick<Job, "id">,
  card: Pick<RecoveryCard, "skips">,
  choice: RecoveryAct | null,
): boolean {
  if (choice !== "skip" && choice !== "done_by_hand") return false;
  const left = run.jobs.filter((other) => other.id !== job.id && !isSettled(other));
  return left.length === (choice === "skip" ? card.skips.length : 0);
}

const isSettled = (job: Job): boolean =>
  job.state === "complete" || (isFinalJob(job.state) && job.passed_by !== null);

const ID = /^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$/;

/** Whether a value names a thing of the lab. */
export const isId = (value: unknown): value is string =>
  typeof value === "string" && ID.test(value);

/** A changed value in the sort that it had. */
export function readValue(text: string, before: unknown): unknown {
  if (typeof before === "string" || before === undefined || before === null) return text;
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return text;
  }
}
