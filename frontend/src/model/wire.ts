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
import type { DeviceHalt, DeviceRow, HostAway, HostRow } from "./wirelab";
import type { Asks, Recovery, RecoveryCard, RecoveryChoice } from "./wirerecovery";

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

export interface StopHost {
  id: Id;
  name: string;
  state: string;
  acknowledged_at: Iso | null;
  /** From the click to the acknowledgement, seconds. */
  after_s: number | null;
}

export interface Lab {
  id: Id;
  key: string;
  name: string;
  mode: Mode;
  time_zone: string;
  speed: number;
  stop: {
    is_stopped: boolean;
    stop_id: Id | null;
    stopped_at: Iso | null;
    stopped_by: string | null;
    hosts: StopHost[];
  };
  counts: { runs_live: number; approvals_open: number; drivers_open: number; needs_you: number };
}

export interface Session {
  user: User | null;
  lab: Lab | null;
}

export type Need = Answers["Need"];

export interface Home {
  needs_you: Need[];
  running: RunRow[];
  last_results: RunRow[];
  workflows: WorkflowRow[];
  devices: DeviceRow[];
  hosts: HostRow[];
}

export type PortKind = "done" | "material" | "data";

export interface StepPort {
  name: string;
  kind: PortKind;
  label: string;
}

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

export interface WorkflowRow {
  id: Id;
  name: string;
  description: string;
  is_template: boolean;
  latest_version: { id: Id; number: number } | null;
  steps_count: number;
  updated_at: Iso;
  updated_by: string | null;
  last_run: LastRun | null;
}

export interface LastRun {
  id: Id;
  number: number;
  state: string;
  ended_at: Iso | null;
  /** What a person has to say before it can go on. */
  waits_for: "answer" | "recovery" | null;
}

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
export interface Proof {
  version: number;
  changes: Finding[];
}

export interface PauseReason {
  kind: string;
  by: string | null;
  at: Iso;
}

export interface RunRow {
  id: Id;
  number: number;
  workflow: { id: Id; name: string; version: number };
  mode: Mode;
  state: RunState;
  created_by: string;
  created_at: Iso;
  started_at: Iso | null;
  ended_at: Iso | null;
  steps_total: number;
  steps_done: number;
  step_now: string | null;
  in_doubt_count: number;
  estimate_s: number;
  left_s: number | null;
  pause_reasons: PauseReason[];
  recoveries: Recovery[];
  /** Somebody aborted it: it ends once each of its devices stands, or does not answer. */
  is_given_up: boolean;
  /** The run that keeps what this one needs, or asked for it before. */
  waits_for: WaitsFor | null;
  /** What the run keeps for itself now. */
  holds: Hold[];
}

export interface WaitsFor {
  id: Id;
  number: number;
  resource: string;
  until_step: number | null;
  /** The whole sentence: "waits for run #12, which holds Reactor 1 until its step 7". */
  text: string;
}

export interface Hold {
  resource_id: Id;
  resource: string;
  /** Others may draw from it, or pour into it, too. */
  is_shared: boolean;
  until_step: number;
}

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
export interface Measured {
  /** The subtraction in words, or which reading is missing. */
  text: string;
  before_ul: number | null;
  after_ul: number | null;
  moved_ul: number | null;
  tolerance_ul: number;
  answer: "happened" | "did_not" | "partly" | null;
  /** Answers without an amount that the readings contradict. */
  contradicts: string[];
}

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

export interface Question {
  text: string;
  /** The try that is in doubt: an answer names it. */
  attempt_id: Id | null;
  asked_ul: number | null;
  source: string | { id: Id; name: string } | null;
  target: string | { id: Id; name: string } | null;
  /** What the readings say; null: no reading tells how far such an action came. */
  measured: Measured | null;
  /** By answer: what may follow it in the same request. */
  then: Record<string, RecoveryChoice[]>;
  answer_sent: boolean;
  /** Who has answered, and when, while the host has not heard of it. */
  answered_by: string | null;
  answered_at: Iso | null;
}

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
export interface Departure {
  place: string;
  text: string;
}

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
