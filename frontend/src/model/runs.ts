/** What a run's jobs say about its steps, and what stands in the way. */

import { toSeconds } from "./format";
import { plannedDevice } from "./roles";
import { capitalise, isActiveJob, isFinalJob, type Look } from "./states";
import type {
  Departure,
  Iso,
  Job,
  JobState,
  PauseReason,
  PlannedStep,
  Question,
  Run,
} from "./wire";

export type StepState =
  "planned" | "waiting" | "running" | "done" | "by hand" | "skipped" | "doubt" | "failed";

export interface StepProgress {
  number: number;
  step: PlannedStep;
  state: StepState;
  look: Look;
  jobs: Job[];
  started_s: number | null;
  ended_s: number | null;
  /** Number of the step that has to be settled first, when one holds this up. */
  after: number | null;
}

const LOOKS: Record<StepState, Look> = {
  planned: "idle",
  waiting: "queued",
  running: "running",
  done: "ok",
  "by hand": "ok",
  skipped: "idle",
  doubt: "doubt",
  failed: "error",
};

/** Derive each step's state from its jobs, in the order of the plan. */
export function stepProgress(run: Pick<Run, "plan" | "jobs" | "is_given_up">): StepProgress[] {
  const steps = run.plan.steps.map((step, place): StepProgress => {
    const jobs = run.jobs.filter((job) => job.step_id === step.step_id);
    const state = stateOf(jobs, run.is_given_up);
    const starts = jobs.map((job) => toSeconds(job.started_at)).filter((at) => at !== null);
    const ends = jobs.map((job) => toSeconds(job.ended_at)).filter((at) => at !== null);
    const over = jobs.length > 0 && jobs.every((job) => isFinalJob(job.state));
    return {
      number: place + 1,
      step,
      state,
      look: LOOKS[state],
      jobs,
      started_s: starts.length ? Math.min(...starts) : null,
      ended_s: over && ends.length ? Math.max(...ends) : null,
      after: null,
    };
  });
  return steps.map((step) => (step.state === "planned" ? held(step, steps, run.jobs) : step));
}

/** The halt that ends an aborted run takes away what its steps had set: they were done all the same. */
function stateOf(all: readonly Job[], isGivenUp: boolean): StepState {
  const jobs = all.filter((job) => job.passed_by !== "change");
  if (jobs.some((job) => job.state === "in_doubt")) return "doubt";
  const left = jobs.filter((job) => !job.passed_by);
  if (left.some((job) => ["aborted", "stopped", "rejected"].includes(job.state))) return "failed";
  if (!isGivenUp && left.some(isTakenAway)) return "failed";
  if (jobs.length > 0 && left.every((job) => job.state === "complete")) return doneAs(jobs);
  if (jobs.some((job) => isActiveJob(job.state) || job.state === "complete")) return "running";
  return "planned";
}

/** A step of which a person left out or did something is never shown as if its devices did all. */
function doneAs(jobs: readonly Job[]): StepState {
  if (jobs.some((job) => job.passed_by === "skip")) return "skipped";
  return jobs.some((job) => job.passed_by === "hand") ? "by hand" : "done";
}

function held(
  step: StepProgress,
  steps: readonly StepProgress[],
  all: readonly Job[],
): StepProgress {
  const before = new Set<number>();
  const open = step.jobs.flatMap((job) => job.after);
  for (let index = open.pop(); index !== undefined; index = open.pop()) {
    if (before.has(index)) continue;
    before.add(index);
    open.push(...(all.find((job) => job.index === index)?.after ?? []));
  }
  const blocker = steps.find(
    (other) =>
      (other.state === "doubt" || other.state === "failed") &&
      other.jobs.some((job) => before.has(job.index)),
  );
  if (!blocker) return step;
  return { ...step, state: "waiting", look: LOOKS.waiting, after: blocker.number };
}

/** The step that counts as the present one: in doubt, running, else the next. */
export function currentStep(steps: readonly StepProgress[]): StepProgress | null {
  return (
    steps.find((step) => step.state === "running") ??
    steps.find((step) => step.state === "doubt" || step.state === "failed") ??
    steps.find((step) => step.state === "planned") ??
    steps.at(-1) ??
    null
  );
}

export type Problem =
  | { kind: "doubt"; job: Job; question: Question }
  | { kind: "failed"; job: Job }
  | { kind: "paused" };

/** It was done, a halt of its device undid it, and nobody has said what becomes of that. */
export const isTakenAway = (job: Pick<Job, "state" | "halted_by">): boolean =>
  job.state === "complete" && job.halted_by !== null && job.halted_by !== "let_go";

/** Of a run that was aborted: what never began. */
export const neverBegan = (run: Run): Job[] =>
  run.is_given_up ? run.jobs.filter((job) => job.state === "stopped" && !job.passed_by) : [];

/**
 * What needs a person, most urgent first. What an abort itself keeps from beginning, or takes
 * away of what was set, is no problem: the card of the abort says it.
 */
export function findProblems(run: Run): Problem[] {
  const problems: Problem[] = [];
  for (const job of run.jobs) {
    if (job.state === "in_doubt") {
      const question = job.question ?? {
        text: `What became of “${job.sentence}”?`,
        asked_ul: null,
        source: "",
        target: "",
        attempt_id: null,
        measured: null,
        then: {},
        answer_sent: false,
        answered_by: null,
        answered_at: null,
      };
      problems.push({ kind: "doubt", job, question });
    }
  }
  for (const job of run.jobs) {
    const isWanted = run.is_given_up && (job.state === "stopped" || isTakenAway(job));
    const isUndone = ["aborted", "rejected", "stopped"].includes(job.state) && !job.passed_by;
    if (!isWanted && (isUndone || isTakenAway(job))) problems.push({ kind: "failed", job });
  }
  const isPausing = run.state === "paused" || run.state === "pausing";
  if (isPausing && (run.pause_reasons.length > 0 || problems.length === 0)) {
    problems.push({ kind: "paused" });
  }
  return problems;
}

const PAUSES: Record<string, string> = {
  user: "Paused",
  stopped: "Lab stopped",
  device_stopped: "A device of it was stopped",
  halted: "A halt undid what a step had set",
  lost: "A device does not keep what a step had set",
  recovery: "Waits to be resumed after a decision",
  "server error": "The server cannot dispatch it",
};

/** Why a run is paused, in words, and who stands behind it. */
export const pauseText = ({ kind, by }: PauseReason): string =>
  `${PAUSES[kind] ?? capitalise(kind)}${by ? ` by ${by}` : ""}`;

/** Which pauses a person sees who resumes a run: one that came later is not lifted unseen. */
export const pausesSeen = (run: Pick<Run, "pause_reasons">): Iso[] =>
  run.pause_reasons.map((reason) => reason.at);

/** Place of a job in words: "step 4". */
export function stepNumber(run: Pick<Run, "plan">, stepId: string): number {
  return run.plan.steps.findIndex((step) => step.step_id === stepId) + 1;
}

/** Devices of a run in the order they first act. */
export function devicesOf(jobs: readonly Job[]): { id: string; name: string }[] {
  const found = new Map<string, { id: string; name: string }>();
  for (const job of jobs) if (!found.has(job.device.id)) found.set(job.device.id, job.device);
  return [...found.values()];
}

/** It left what was proved, and nobody has said yet that it goes on so. */
export function isHeldByProof(run: Run): boolean {
  const { proof } = run;
  if (proof === null) return false;
  const accepted = new Set(proof.accepted.map(toldAs));
  return proof.departures.some((one) => !accepted.has(toldAs(one)));
}

function toldAs({ place, text }: Departure): string {
  return JSON.stringify([place, text]);
}

const UNSENT = new Set<JobState>(["draft", "awaiting_approval", "queued", "held", "suspended"]);

/** Who does a job, or that nobody is chosen yet. */
export const deviceName = (job: Pick<Job, "device" | "choices_count" | "state">): string =>
  UNSENT.has(job.state) ? plannedDevice(job) : job.device.name;

/** Whether an action is complete though nobody could confirm it, as its step lets it be. */
export const isUnconfirmed = (job: Pick<Job, "state" | "verification">): boolean =>
  job.state === "complete" && job.verification === "unconfirmed";
