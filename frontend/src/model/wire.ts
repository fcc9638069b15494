/** What crosses the border between server and browser; named as the server names it. */

export type * from "./wirebase";
export type * from "./wirelab";
export type * from "./wiredrivers";
export type * from "./wirerecovery";
import type { components } from "./api.gen";
import type {
  DeviceAction,
  Finding,
  Id,
  Iso,
  JobState,
  Plan,
  Schema,
  SentencePart,
  Version,
  WorkflowDocument,
} from "./wirebase";
import type { RunFile } from "./wirefiles";
import type { DeviceHalt, HostAway } from "./wirelab";
import type { Asks, RecoveryCard } from "./wirerecovery";

type Answers = components["schemas"];

export interface Refusal {
  code: string;
  message: string;
  effect: "none" | "partial" | "unknown";
  context: Record<string, unknown>;
  findings: Finding[];
}

export type Mode = "sim" | "live";

export type User = Answers["SignedInUser"];

export type StopHost = Answers["StopHost"];

export type Lab = Answers["LabSummary"];

export type Session = Answers["OpenSession"];

export type Need = Answers["HomeNeed"];

export type Home = Answers["HomePage"];

export type PortKind = "done" | "material" | "data";

export type StepPort = Answers["StepPort"];

export interface UnitOperation {
  kind: string;
  label: string;
  help: string;
  clauses: string[];
  inputs: StepPort[];
  outputs: StepPort[];
  params: Schema;
}

export interface PaletteDevice {
  id: Id;
  name: string;
  role: string;
  roles: string[];
  state: string;
  actions: DeviceAction[];
}

export interface UnitTable {
  canonical: string;
  units: string[];
  /** Another spelling → the unit that it means; none where the browser has the table itself. */
  spellings?: Record<string, string>;
  suffix: string;
}

export interface Steps {
  steps: UnitOperation[];
  devices: PaletteDevice[];
  units: Record<string, UnitTable>;
}

export type WorkflowRow = Answers["WorkflowOverview"];

export type LastRun = Answers["LastRunOf"];

export interface Workflow extends WorkflowRow {
  draft: WorkflowDocument;
  /** What the page left out or moved so that the draft can be shown. */
  draft_notes?: string[];
  draft_revision: number;
  versions: Version[];
  can_edit: boolean;
}

export interface CheckResult {
  findings: Finding[];
  plan: Plan | null;
  policies: string[];
  sentences: Record<string, SentencePart[]>;
  proof: Proof | null;
}

/** The version whose recipe was proved, and what took the proof away since; nothing: it holds. */
export type Proof = Answers["DraftProof"];

export type PauseReason = Answers["PauseReason"];

export type RunRow = Answers["RunRow"];

export type WaitsFor = Answers["RunWait"];

export type Hold = Answers["RunHoldRow"];

export type RunState =
  | "draft"
  | "awaiting_approval"
  | "queued"
  | "running"
  | "pausing"
  | "paused"
  | "completing"
  | "complete"
  | "aborted";

/** How much the readings before and since say was moved. */
export type Measured = Answers["MeasuredAmount"];

/** What a person answered about a doubt, and when that ended it. */
export interface Resolution {
  answer: string;
  note: string;
  by?: string;
  moved_nl?: number | null;
  despite_reading?: string | null;
  doubt_at?: Iso | null;
  at?: Iso | null;
}

export type Question = Answers["JobQuestion"];

/** One condition, with what was seen. */
export interface ConditionResult {
  name: string;
  verdict: string;
  message: string;
  evidence?: Record<string, unknown>;
}

/** A number that a calibration made right, as asked and as sent; both null: it is read. */
export interface Correction {
  argument: string;
  quantity: "volume" | "ph" | "temperature";
  asked: number | null;
  sent: number | null;
  number: number;
}

export interface Job {
  id: Id;
  index: number;
  step_id: string;
  sentence: string;
  device: { id: Id; name: string; key: string };
  /** How many devices may do it, where its step asks for a role; 0: its device alone. */
  choices_count: number;
  /** Why it is that device, or why it waits for any. */
  chosen: string | null;
  action: string;
  args: Record<string, unknown>;
  corrections: Correction[];
  operation: unknown;
  state: JobState;
  state_at: Iso | null;
  started_at: Iso | null;
  ended_at: Iso | null;
  estimate_s: number;
  verification: string;
  code: string;
  message: string;
  evidence: {
    report?: Record<string, unknown> | null;
    pre?: ConditionResult[] | null;
    post?: ConditionResult[] | null;
    resolution?: Resolution | null;
    /** What was to follow the answer and could not be done any more. */
    then_failed?: { choice: string; why_not: string } | null;
    /** Of what was read: the corrected value beside what the device told. */
    corrected?: Record<string, { raw: number; value: number | null; number: number }> | null;
  };
  after: number[];
  transaction: { id: Id; state: string } | null;
  passed_by: "skip" | "hand" | "change" | null;
  /** Why its device was halted after it was done, which undid it; `let_go`: somebody goes on so. */
  halted_by: string | null;
  /** Whether that ends for certain what it had begun; of a foreign node only its maker knows. */
  is_halt_certain: boolean;
  recovery_class: string;
  question: Question | null;
  recovery?: RecoveryCard | null;
  /** What a person confirms before it is sent, and who has; null: nothing. */
  asks?: Asks | null;
}

/** One way in which a run leaves what was proved, at its job or step. */
export type Departure = Answers["Departure"];

export interface Run extends RunRow {
  document: WorkflowDocument;
  plan: Plan;
  jobs: Job[];
  /** Who aborted it, when and why; null: nobody has, or it was before this was written down. */
  given_up: { by: string; at: Iso; reason: string } | null;
  /** Of an aborted run: its devices that had to be halted, and what came of it. */
  halts: DeviceHalt[];
  files: RunFile[];
  approval: { id: Id; state: string } | null;
  /** How a run of a recipe leaves what was proved, and who let it go on so; null: no recipe. */
  proof: {
    departures: Departure[];
    accepted: Departure[];
    by: string | null;
    at: Iso | null;
  } | null;
  /** What the workflow declares for hosts that cannot hear the server; null: nothing. */
  execution: { on_disconnect: string; max_offline_s: number } | null;
  hosts_away: HostAway[];
  /** Devices on which something of the run stands, and of which it cannot be read back. */
  silent: { device: { id: Id; name: string }; since_at: Iso; sentences: string[] }[];
  /** Answers of people about doubts that a device reads otherwise since; each is a ticket. */
  contradicted: { ticket_id: Id; text: string; opened_at: Iso }[];
  can: {
    pause: boolean;
    resume: boolean;
    abort: boolean;
    resolve: boolean;
    recover: boolean;
    confirm: boolean;
  };
}
