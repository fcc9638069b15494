/** What crosses the border about jobs that ended undone. */

import type { components } from "./api.gen";

/** What a person chose about a job that ended undone. */
export type Recovery = components["schemas"]["RunRecovery"];

export type RecoveryName = "retry" | "change" | "done_by_hand" | "skip";

export type RecoveryChoice = components["schemas"]["RecoveryChoice"];

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
export type LotThere = components["schemas"]["LotThere"];

/** Lots of a vessel of which a person says how much is meant. */
export type States = components["schemas"]["StatementAsked"];

/** What a person confirms before a job is sent, and who has. */
export type Asks = components["schemas"]["JobAsks"];
