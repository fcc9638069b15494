/** What crosses the border about recipes that are opened on a rig. */

import type { Finding, Id, Version } from "./wirebase";
import type { WorkflowDocument } from "./wire";

/**
 * What a finding is about: the recipe, the graph, both together, what was asked, what is stated,
 * or the workflow that the recipe becomes.
 */
export interface RecipeFinding extends Finding {
  about: "recipe" | "graph" | "rig" | "wish" | "declared" | "workflow";
}

export interface RigNode {
  key: string;
  kind: string;
  role: string;
  sort: string | null;
  chemical: string;
  holds: { name: string; volume_ul: number }[];
}

export interface RigTube {
  key: string;
  source: string;
  source_port: string;
  target: string;
  target_port: string;
  medium: string;
}

export interface Rig {
  format: string;
  sha256: string;
  nodes: RigNode[];
  tubes: RigTube[];
  defects: Finding[];
}

export interface PlannedAction {
  device: string;
  action: string;
  parameters: Record<string, unknown>;
}

export type Claim = { kind: string } & Record<string, unknown>;

export interface PlannedStep {
  id: number;
  of: {
    operation: string;
    line?: number;
    column?: number;
    act: number;
    queue?: string;
    beside?: string;
  };
  does: Claim;
  /** Groups one after another; the actions of one group run at the same time. */
  actions: PlannedAction[][];
  after: number[];
  estimate_s: number;
  skip_if?: number[];
  /** Tubes that its liquid goes through. */
  route: string[];
}

export interface PlanTotals {
  duration_s: number;
  critical_path_s: number;
  needed_ul: Record<string, number>;
  needed_ug: Record<string, number>;
  by_hand_count: number;
}

export interface RecipePlan {
  bindings: { vessels: Record<string, string>; reagents: Record<string, string | string[]> };
  steps: PlannedStep[];
  totals: PlanTotals;
  notes: string[];
}

export interface RoleBinding {
  role: string;
  what: "vessel" | "reagent";
  told: string;
  keys: string[];
  choices: string[];
  /** Vessels whose label only looks like it: never taken by themselves. */
  alike: string[];
  is_by_hand: boolean;
  /** By the file that is stated beside the recipe. */
  is_stated: boolean;
}

/** A value that the recipe leaves to whoever uses it; texts with units, "" for none. */
export interface RecipeParameter {
  id: string;
  sort: string;
  unit: string;
  value: string;
  least: string;
  most: string;
}

export interface Opening {
  recipe: {
    name: string;
    version: string;
    sha256: string;
    is_compiled: boolean;
    syntheses_count: number;
    steps_count: number;
    parameters: RecipeParameter[];
    cleans_with: string[];
  } | null;
  rig: Rig | null;
  bindings: RoleBinding[];
  findings: RecipeFinding[];
  /** Null unless the verifier has proved it. */
  plan: RecipePlan | null;
  is_proved: boolean | null;
  /** The workflow of this lab that does the same; null on another rig, or where there is none. */
  document: WorkflowDocument | null;
}

export type RecipeAdvice =
  | {
      ok: true;
      changes: { change: string; text: string; adds: string[] }[];
      graph_sha256: string;
      graph: string;
    }
  | { ok: false; findings: Finding[] };

export interface KeptRecipe {
  workflow_id: Id;
  version: Version;
}
