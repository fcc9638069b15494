/** A small plan on a small rig, for tests. */

import type { CheckResult } from "./wire";
import type { Opening, PlannedStep, RecipePlan, Rig, RigNode } from "./wirerecipe";

export function aPlannedStep(told: Partial<PlannedStep>): PlannedStep {
  return {
    id: 1,
    of: { operation: "Add", line: 2, column: 3, act: 1 },
    does: { kind: "transfer", from: "flask", to: "reactor", volume_ul: 5000, lot: "water" },
    actions: [
      [
        { device: "valve", action: "set_port", parameters: { port: "1" } },
        { device: "valve_2", action: "set_port", parameters: { port: "2" } },
      ],
      [{ device: "pump", action: "aspirate", parameters: { volume_ul: 5000 } }],
    ],
    after: [],
    estimate_s: 10,
    route: ["1", "2", "3"],
    ...told,
  };
}

export function aPlan(steps: PlannedStep[]): RecipePlan {
  return {
    bindings: { vessels: { reactor: "reactor" }, reagents: { water: "flask" } },
    steps,
    totals: {
      duration_s: 10 * steps.length,
      critical_path_s: 10,
      needed_ul: { water: 5000 },
      needed_ug: {},
      by_hand_count: 0,
    },
    notes: ["Add: a note"],
  };
}

export function aRig(): Rig {
  const tube = { medium: "liquid" as const };
  const holds: RigNode["holds"] = [];
  return {
    format: "node_link",
    sha256: "ab",
    nodes: [
      {
        key: "flask",
        kind: "ChemputerFlask",
        role: "vessel",
        sort: "flask",
        chemical: "water",
        holds,
      },
      { key: "valve", kind: "ChemputerValve", role: "valve", sort: null, chemical: "", holds },
      { key: "pump", kind: "ChemputerPump", role: "pump", sort: null, chemical: "", holds },
    ],
    tubes: [
      { key: "1", source: "pump", source_port: "0", target: "valve", target_port: "-1", ...tube },
      { key: "2", source: "valve", source_port: "-1", target: "pump", target_port: "0", ...tube },
      { key: "3", source: "flask", source_port: "0", target: "valve", target_port: "1", ...tube },
    ],
    defects: [],
  };
}

export function anOpening(told: Partial<Opening> = {}): Opening {
  return {
    recipe: {
      name: "warm",
      version: "2.0",
      sha256: "cd",
      is_compiled: false,
      syntheses_count: 1,
      steps_count: 1,
      parameters: [],
      cleans_with: [],
    },
    rig: aRig(),
    bindings: [
      {
        role: "water",
        what: "reagent",
        told: "",
        keys: ["flask"],
        choices: ["flask", "other"],
        alike: [],
        is_by_hand: false,
        is_stated: false,
      },
    ],
    findings: [],
    plan: aPlan([
      aPlannedStep({}),
      aPlannedStep({ id: 2, route: [], does: { kind: "ask", text: "Ready?" } }),
    ]),
    is_proved: true,
    document: { schema: "labweb.workflow/1", name: "warm", steps: [], edges: [] },
    ...told,
  };
}

/** What a lab answers where the workflow would start. */
export function aCheck(told: Partial<CheckResult> = {}): CheckResult {
  return {
    findings: [],
    plan: { digest: "cd", estimate_s: 0, steps: [], jobs: [], notes: [], proved: null },
    policies: [],
    sentences: {},
    proof: null,
    ...told,
  };
}
