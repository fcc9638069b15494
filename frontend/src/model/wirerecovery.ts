/** What crosses the border about jobs that ended undone. */

import type { Id, Iso } from "./wirebase";

/** What a person chose about a job that ended undone. */
export interface Recovery {
  choice: RecoveryName;
  job_id: Id;
  by: string;
  at: Iso;
  note: string;
  /** What was moved by hand. */
  moved_nl?: number | null;
  /** Places in the plan of what was skipped with it. */
  with?: number[];
}

export type RecoveryName = "retry" | "change" | "done_by_hand" | "skip";

export interface RecoveryChoice {
  name: RecoveryName;
  why_not: string | null;
  consequence: string;
}

export interface RecoveryCard {
  recovery: string;
  tries: number;
  choices: RecoveryChoice[];
  /** Sentences of the jobs that are skipped with it. */
  skips: string[];
  /** Sentences of later jobs that use what it was to change. */
  relying: string[];
  asked_ul: number | null;
  /** What the device has moved of it, over all its tries. */
  moved_ul: number | null;
  params: Record<string, unknown>;
}

/** A lot of which a person says how much of it is meant. */
export interface LotThere {
  key: string;
  name: string;
  /** How much there is of a liquid; null: it is a solid. */
  held_ul: number | null;
  held_mg: number | null;
}

/** Lots of a vessel of which a person says how much is meant. */
export interface States {
  label: string;
  /** With nothing of any lot the step is left out; else each lot is stated, "none" too. */
  leaves_out: boolean;
  lots: LotThere[];
}

/** What a person confirms before a job is sent, and who has. */
export interface Asks {
  text: string;
  /** What they state of each lot of a vessel in its place, once it is due. */
  states: States | null;
  is_due: boolean;
  confirmed_by: string | null;
  confirmed_at: Iso | null;
}
