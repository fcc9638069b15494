/** What crosses the border about recipes that are opened on a rig. */

import type { components } from "./api.gen";
import type { Finding, Refined } from "./wirebase";
import type { WorkflowDocument } from "./wire";

type Answers = components["schemas"];

/**
 * What a finding is about: the recipe, the graph, both together, what was asked, what is stated,
 * or the workflow that the recipe becomes.
 */
export type RecipeFinding = Answers["RecipeFinding"];

export type RigNode = Answers["RigNode"];

export type RigTube = Answers["RigTube"];

export type Rig = Refined<Answers["RigPicture"], { defects: Finding[] }>;

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

export type RoleBinding = Answers["RoleBinding"];

/** A value that the recipe leaves to whoever uses it; texts with units, "" for none. */
export type RecipeParameter = Answers["RecipeParameter"];

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

export type KeptRecipe = Answers["KeptRecipe"];
