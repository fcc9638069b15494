/** What people decided about the actions of a run, and answered. */

import { formatVolume, toSeconds } from "./format";
import { runState, type State } from "./states";
import type { Iso, Job, RecoveryName, Run } from "./wire";

export interface Decided {
  job: Job;
  what: string;
  by: string | null;
  at: Iso | null;
  note: string;
}

const CHOSEN: Record<RecoveryName, string> = {
  retry: "To be tried again",
  change: "Planned anew with other values",
  done_by_hand: "Done by hand",
  skip: "Skipped",
};

const ANSWERED: Record<string, string> = {
  happened: "It happened",
  did_not: "It did not happen",
  partly: "It happened partly",
  discard: "Nobody can tell",
};

/** State of a run; one that a person had to bring to its end says so. */
export function runOutcome(
  run: Pick<Run, "state" | "recoveries"> & Partial<Pick<Run, "is_given_up">>,
): State {
  if (run.is_given_up && run.state === "running") return { look: "stopped", word: "Aborting" };
  const state = runState(run.state);
  const count = run.recoveries.length;
  if (run.state !== "complete" || count === 0) return state;
  return { ...state, word: `${state.word}, ${count} ${count === 1 ? "recovery" : "recoveries"}` };
}

/** Every choice and answer of people about the actions of a run, newest first. */
export function decisions(run: Pick<Run, "jobs" | "recoveries">): Decided[] {
  const choices = run.recoveries.flatMap((one): Decided[] => {
    const job = run.jobs.find((other) => other.id === one.job_id);
    const amount = one.moved_nl ? `, ${formatVolume(one.moved_nl)}` : "";
    const more = one.with?.length ? `, with ${one.with.length} more of its step` : "";
    const what = `${CHOSEN[one.choice]}${amount}${more}`;
    return job ? [{ job, what, by: one.by, at: one.at, note: one.note }] : [];
  });
  const found = [...choices, ...run.jobs.flatMap(answerOf)];
  return found.sort((a, b) => (toSeconds(b.at) ?? 0) - (toSeconds(a.at) ?? 0));
}

function answerOf(job: Job): Decided[] {
  const told = job.evidence.resolution;
  if (!told) return [];
  const answer = text(told.answer);
  const amount = typeof told.moved_nl === "number" ? `, ${formatVolume(told.moved_nl)}` : "";
  const what = `${ANSWERED[answer] ?? answer}${amount}`;
  return [{ job, what, by: text(told.by) || null, at: job.ended_at, note: text(told.note) }];
}

const text = (value: unknown): string => (typeof value === "string" ? value : "");
