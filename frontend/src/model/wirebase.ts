/** What the messages of every page are made of; it knows none of them. */

import type { components } from "./api.gen";

type Answers = components["schemas"];
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

export type PlannedJob = Answers["PlanJob"];

export type PlannedStep = Answers["PlannedStep"];

export type Plan = Answers["PlanView"];

/** Steps whose movements of matter the plan was proved to make, and steps that no proof covers. */
export type Proved = Answers["PlanProof"];

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
