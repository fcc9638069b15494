/** What the messages of every page are made of; it knows none of them. */

import type { components } from "./api.gen";

type Answers = components["schemas"];
/** An answer of which some fields are known better than its schema says. */
export type Refined<Answer, Fields> = Omit<Answer, keyof Fields> & Fields;

export type Id = string;
export type Iso = string;

/** What the server leaves out of a finding it does not leave out of an answer. */
export type Finding = Required<Answers["Finding"]>;

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

/** What a form of arguments needs of an action. */
export type ActionForm = Pick<DeviceAction, "name" | "label" | "doc" | "schema">;

export type DeviceAction = Refined<Answers["DeviceAction"], { schema: Schema }>;

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

export type Version = Answers["VersionRow"] & { document?: WorkflowDocument };

/** Words of a sentence; the browser makes plain ones, too. */
export type SentencePart = Pick<Answers["WordsOfStep"], "text"> & Partial<Answers["WordsOfStep"]>;

export type PlannedJob = Answers["PlanJob"];

export type PlannedStep = Answers["PlannedStep"];

export type Plan = Answers["PlanView"];

/** Steps whose movements of matter the plan was proved to make, and steps that no proof covers. */
export type Proved = Answers["PlanProof"];

export type JobState = Answers["JobState"];
