/** What crosses the border between server and browser; named as the server names it. */

export type * from "./wirebase";
export type * from "./wirelab";
export type * from "./wiredrivers";
export type * from "./wirerecovery";
import type { components } from "./api.gen";
import type {
  DeviceAction,
  Finding,
  Iso,
  Schema,
  Refined,
  Version,
  WorkflowDocument,
} from "./wirebase";

type Answers = components["schemas"];

export interface Refusal {
  code: string;
  message: string;
  effect: "none" | "partial" | "unknown";
  context: Record<string, unknown>;
  findings: Finding[];
}

export type Mode = Answers["LabMode"];

export type User = Answers["SignedInUser"];

export type StopHost = Answers["StopHost"];

export type Lab = Answers["LabSummary"];

export type Session = Answers["OpenSession"];

export type Need = Answers["HomeNeed"];

export type Home = Answers["HomePage"];

export type PortKind = "done" | "material" | "data";

export type StepPort = Answers["StepPort"];

export type UnitOperation = Refined<Answers["StepChoice"], { params: Schema }>;

export type PaletteDevice = Refined<Answers["PaletteDevice"], { actions: DeviceAction[] }>;

/** Spellings lack where the browser has the table itself. */
export type UnitTable = Refined<
  Answers["UnitTable"],
  { spellings?: Answers["UnitTable"]["spellings"] }
>;

export type Steps = Refined<
  Answers["StepPalette"],
  { steps: UnitOperation[]; devices: PaletteDevice[] }
>;

export type WorkflowRow = Answers["WorkflowOverview"];

export type LastRun = Answers["LastRunOf"];

/** With what the page left out or moved so that the draft can be shown. */
export type Workflow = Refined<
  Answers["WorkflowDetail"],
  { draft: WorkflowDocument; draft_notes?: string[]; versions: Version[] }
>;

export type CheckResult = Answers["WorkflowCheck"];

/** The version whose recipe was proved, and what took the proof away since; nothing: it holds. */
export type Proof = Answers["DraftProof"];

export type PauseReason = Answers["PauseReason"];

export type RunRow = Answers["RunRow"];

export type WaitsFor = Answers["RunWait"];

export type Hold = Answers["RunHoldRow"];

export type RunState = Answers["RunState"];

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
export type Correction = Answers["Correction"];

/** What speaks for the state of a job. */
export interface Evidence {
  report?: Record<string, unknown> | null;
  pre?: ConditionResult[] | null;
  post?: ConditionResult[] | null;
  resolution?: Resolution | null;
  /** What was to follow the answer and could not be done any more. */
  then_failed?: { choice: string; why_not: string } | null;
  /** Of what was read: the corrected value beside what the device told. */
  corrected?: Record<string, { raw: number; value: number | null; number: number }> | null;
}

export type Job = Refined<Answers["JobRow"], { evidence: Evidence }>;

/** One way in which a run leaves what was proved, at its job or step. */
export type Departure = Answers["Departure"];

export type Run = Refined<Answers["RunDetail"], { document: WorkflowDocument; jobs: Job[] }>;
