/** What crosses the border about jobs that ended undone. */

import type { components } from "./api.gen";

type Answers = components["schemas"];

/** What a person chose about a job that ended undone. */
export type Recovery = Answers["RunRecovery"];

export type RecoveryName = "retry" | "change" | "done_by_hand" | "skip";

export type RecoveryChoice = Answers["RecoveryChoice"];

export type RecoveryCard = Answers["RecoveryCard"];

/** A lot of which a person says how much of it is meant. */
export type LotThere = Answers["LotThere"];

/** Lots of a vessel of which a person says how much is meant. */
export type States = Answers["StatementAsked"];

/** What a person confirms before a job is sent, and who has. */
export type Asks = Answers["JobAsks"];
