/** What the messages of every page are made of; it knows none of them. */

export type Id = string;
export type Iso = string;

export interface Finding {
  code: string;
  message: string;
  subject: string;
  context: Record<string, unknown>;
}

/** The parts of JSON Schema 2020-12 that steps and drivers use. */
export interface Schema {
  type?: string | string[];
  title?: string;
  description?: string;
  properties?: Record<string, Schema>;
  required?: string[];
  enum?: unknown[];
  default?: unknown;
  minimum?: number;
  maximum?: number;
  maxLength?: number;
  additionalProperties?: boolean | Schema;
  items?: Schema;
  "x-label"?: string;
  "x-help"?: string;
  "x-order"?: number;
  "x-advanced"?: boolean;
  "x-quantity"?: string;
  "x-unit"?: string;
  /** `all` may stand in the place of a volume. */
  "x-all"?: boolean;
  "x-resource"?: { holds?: string; kind?: string[]; acts?: boolean };
}

export interface DeviceAction {
  name: string;
  label: string;
  doc: string;
  schema: Schema;
}

export interface WorkflowStep {
  id: string;
  kind: string;
  params: Record<string, unknown>;
  position: { x: number; y: number };
  note?: string;
}

export interface WorkflowEdge {
  id: string;
  source: string;
  source_port: string;
  target: string;
  target_port: string;
}

export interface WorkflowDocument {
  schema: string;
  name: string;
  steps: WorkflowStep[];
  edges: WorkflowEdge[];
}

export interface Version {
  id: Id;
  number: number;
  note: string;
  author: string | null;
  at: Iso;
  document?: WorkflowDocument;
}

export interface SentencePart {
  text: string;
  strong?: boolean;
  sort?: string;
}

export interface PlannedJob {
  index: number;
  step_id: string;
  sentence: string;
  device: { id: Id; name: string };
  /** How many devices may do it, where its step asks for a role; 0: its device alone. */
  choices_count: number;
  action: string;
  args: Record<string, unknown>;
  after: number[];
  estimate_s: number;
}

export interface PlannedStep {
  step_id: string;
  kind: string;
  sentence: string;
  estimate_s: number;
}

export interface Plan {
  digest: string;
  estimate_s: number;
  steps: PlannedStep[];
  jobs: PlannedJob[];
  notes: string[];
  /** What of it was carried out on paper; null: it is of before there was a proof. */
  proved: Proved | null;
}

/** Steps whose movements of matter the plan was proved to make, and steps that no proof covers. */
export interface Proved {
  steps: string[];
  beyond: { step_id: string; why: string }[];
}

export type JobState =
  | "draft"
  | "awaiting_approval"
  | "queued"
  | "held"
  | "suspended"
  | "dispatched"
  | "accepted"
  | "running"
  | "completing"
  | "in_doubt"
  | "complete"
  | "aborted"
  | "stopped"
  | "rejected";
