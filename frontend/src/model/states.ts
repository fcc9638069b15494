/** Every state, its word and its look; the same on each page. */

import type { FileState } from "./wirefiles";
import type { DeviceHalt, JobState, LastRun, RunState } from "./wire";

/** Looks of chips, glyphs, bars and tiles. */
export type Look =
  | "idle"
  | "queued"
  | "running"
  | "paused"
  | "ok"
  | "sim"
  | "offline"
  | "needs"
  | "doubt"
  | "error"
  | "stopped";

export interface State {
  look: Look;
  word: string;
}

const RUN: Record<RunState, State> = {
  draft: { look: "idle", word: "Draft" },
  awaiting_approval: { look: "needs", word: "Awaits approval" },
  queued: { look: "queued", word: "Queued" },
  running: { look: "running", word: "Running" },
  pausing: { look: "paused", word: "Pausing" },
  paused: { look: "paused", word: "Paused" },
  completing: { look: "running", word: "Completing" },
  complete: { look: "ok", word: "Complete" },
  aborted: { look: "stopped", word: "Aborted" },
};

const JOB: Record<JobState, State> = {
  draft: { look: "idle", word: "Planned" },
  awaiting_approval: { look: "queued", word: "Awaits approval" },
  queued: { look: "queued", word: "Queued" },
  held: { look: "queued", word: "Held" },
  suspended: { look: "paused", word: "Suspended" },
  dispatched: { look: "running", word: "Sent" },
  accepted: { look: "running", word: "Accepted" },
  running: { look: "running", word: "Running" },
  completing: { look: "running", word: "Confirming" },
  in_doubt: { look: "doubt", word: "In doubt" },
  complete: { look: "ok", word: "Complete" },
  aborted: { look: "error", word: "Aborted" },
  stopped: { look: "stopped", word: "Stopped" },
  rejected: { look: "error", word: "Rejected" },
};

const TRANSACTION: Record<string, State> = {
  committed: { look: "ok", word: "Committed" },
  rolled_back: { look: "idle", word: "Rolled back" },
  quarantined: { look: "doubt", word: "In doubt" },
};

const LINK: Record<string, State> = {
  online: { look: "idle", word: "Online" },
  stale: { look: "offline", word: "Late" },
  offline: { look: "offline", word: "Offline" },
  not_enrolled: { look: "offline", word: "Not enrolled" },
  quarantined: { look: "doubt", word: "Quarantined" },
};

const APPROVAL: Record<string, State> = {
  open: { look: "needs", word: "Open" },
  approved: { look: "ok", word: "Approved" },
  rejected: { look: "error", word: "Rejected" },
  expired: { look: "offline", word: "Expired" },
  stale: { look: "offline", word: "Stale" },
  withdrawn: { look: "idle", word: "Withdrawn" },
};

const NEED: Record<string, State> = {
  in_doubt: { look: "doubt", word: "In doubt" },
  asks: { look: "needs", word: "Waits for you" },
  approval: { look: "needs", word: "Approval" },
  paused: { look: "error", word: "Paused" },
  quarantined: { look: "doubt", word: "Quarantined" },
  ticket: { look: "error", word: "Conflict" },
  stopped: { look: "stopped", word: "Stopped" },
  candidate: { look: "needs", word: "New device" },
  halt_owed: { look: "error", word: "Not halted yet" },
  silent: { look: "offline", word: "Not read" },
  disk: { look: "error", word: "Little room" },
};

/** What an action measured: whether its bytes are here, and were read. */
const FILE: Record<FileState, State> = {
  awaited: { look: "needs", word: "Not here yet" },
  pending: { look: "running", word: "Being read" },
  parsed: { look: "ok", word: "Kept" },
  refused: { look: "error", word: "Not readable" },
  lost: { look: "error", word: "Lost" },
};

const unknown = (word: string): State => ({ look: "idle", word: capitalise(word) });

export const runState = (state: string): State => RUN[state as RunState] ?? unknown(state);

/** State of the newest run of a workflow: what it waits for stands before how it stands. */
export function lastRunState(run: Pick<LastRun, "state" | "waits_for">): State {
  if (run.waits_for === "answer") return { look: "doubt", word: "In doubt, waits for an answer" };
  if (run.waits_for === "recovery") return { look: "error", word: "Waits for recovery" };
  return runState(run.state);
}
export const jobState = (state: string): State => JOB[state as JobState] ?? unknown(state);
export const transactionState = (state: string): State => TRANSACTION[state] ?? unknown(state);
export const linkState = (state: string): State => LINK[state] ?? unknown(state);
export const approvalState = (state: string): State => APPROVAL[state] ?? unknown(state);
const HALT: Record<DeviceHalt["state"], State> = {
  asked: { look: "running", word: "Halt sent" },
  taken: { look: "running", word: "Being halted" },
  owed: { look: "error", word: "Not halted yet" },
  halted: { look: "ok", word: "Halted" },
  kept: { look: "idle", word: "Left on" },
  lost: { look: "error", word: "Cannot be halted" },
};

export const haltState = (halt: Pick<DeviceHalt, "state">): State => HALT[halt.state];
export const fileState = (state: FileState): State => FILE[state];
export const needState = (kind: string): State => NEED[kind] ?? unknown(kind);

export function hostState(state: string, isSilent: boolean): State {
  if (isSilent) return LINK.offline ?? unknown(state);
  return state === "enrolled" || state === "online"
    ? { look: "idle", word: "Online" }
    : unknown(state);
}

export function capitalise(text: string): string {
  const words = text.replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

const FINAL_JOBS = new Set<string>(["complete", "aborted", "stopped", "rejected"]);
const ACTIVE_JOBS = new Set<string>(["dispatched", "accepted", "running", "completing"]);
const LIVE_RUNS = new Set<string>(["queued", "running", "pausing", "paused", "completing"]);

export const isFinalJob = (state: string): boolean => FINAL_JOBS.has(state);
export const isActiveJob = (state: string): boolean => ACTIVE_JOBS.has(state);
export const isLiveRun = (state: string): boolean => LIVE_RUNS.has(state);
