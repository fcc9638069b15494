/** Small workflows and runs for the tests of this folder and of the screens. */

import type {
  DriverPlace,
  DriverRow,
  Job,
  JobState,
  PlannedJob,
  ResourceRow,
  Run,
  UnitOperation,
  UnitTable,
  WorkflowDocument,
} from "./wire";

export const UNITS: Record<string, UnitTable> = {
  volume: {
    canonical: "microliter",
    suffix: "ul",
    units: ["mL", "ml", "uL", "µL", "μL", "ul", "L"],
  },
  temperature: { canonical: "degC", suffix: "c", units: ["°C", "degC", "C", "K"] },
  time: {
    canonical: "second",
    suffix: "s",
    units: ["min", "s", "h", "ms"],
    spellings: { hours: "h", minutes: "min" },
  },
};

const start = { name: "start", kind: "done", label: "Start" } as const;
const done = { name: "done", kind: "done", label: "Done" } as const;
const vessel = (name: string, label: string) => ({ name, kind: "material", label }) as const;

export const OPERATIONS: UnitOperation[] = [
  {
    kind: "transfer",
    label: "Transfer",
    help: "Move liquid.",
    clauses: ["Transfer {volume} from {source} to {target}", " at {flow_rate}"],
    inputs: [start, vessel("source", "From"), vessel("target", "To")],
    outputs: [done, vessel("source", "From"), vessel("target", "To")],
    params: {
      type: "object",
      required: ["source", "target", "volume"],
      properties: {
        source: {
          type: "string",
          "x-resource": { holds: "liquid" },
          "x-label": "From",
          "x-order": 1,
        },
        target: {
          type: "string",
          "x-resource": { holds: "liquid" },
          "x-label": "To",
          "x-order": 2,
        },
        volume: { type: "string", "x-quantity": "volume", "x-unit": "mL", "x-order": 3 },
        flow_rate: { type: "string", "x-quantity": "flow_rate", "x-unit": "mL/min", "x-order": 4 },
      },
    },
  },
  {
    kind: "measure_ph",
    label: "Measure pH",
    help: "Read a transmitter.",
    clauses: ["Measure pH with {transmitter}"],
    inputs: [start],
    outputs: [done, { name: "value", kind: "data", label: "pH" }],
    params: { type: "object", required: ["transmitter"], properties: {} },
  },
];

export function aDocument(): WorkflowDocument {
  const at = (x: number, y: number) => ({ x, y });
  return {
    schema: "labweb.workflow/1",
    name: "Two transfers",
    steps: [
      {
        id: "a",
        kind: "transfer",
        params: { source: "r1", target: "r2", volume: "5 mL" },
        position: at(0, 0),
      },
      {
        id: "b",
        kind: "transfer",
        params: { source: "r2", volume: "1 mL" },
        position: at(300, 0),
        note: "slow",
      },
      { id: "c", kind: "measure_ph", params: { transmitter: "r3" }, position: at(600, 0) },
    ],
    edges: [{ id: "e1", source: "a", source_port: "done", target: "b", target_port: "start" }],
  };
}

export function aPlannedJob(index: number, stepId: string, after: number[] = []): PlannedJob {
  return {
    index,
    step_id: stepId,
    sentence: `Action ${index}`,
    device: { id: index % 2 ? "d2" : "d1", name: index % 2 ? "Pump 2" : "Pump 1" },
    choices_count: 0,
    action: "aspirate",
    args: { volume_ul: 5000 },
    after,
    estimate_s: 10,
  };
}

/** ISO time so many seconds after the start of all samples. */
export const iso = (second: number): string =>
  new Date((1_800_000_000 + second) * 1000).toISOString();
export const BEGIN_S = 1_800_000_000;

export function aJob(
  index: number,
  stepId: string,
  state: JobState,
  change: Partial<Job> = {},
): Job {
  const planned = aPlannedJob(index, stepId);
  return {
    ...planned,
    id: `j${index}`,
    device: { ...planned.device, key: planned.device.id },
    chosen: null,
    corrections: [],
    operation: {},
    state,
    state_at: iso(0),
    uncertainty_s: null,
    is_bounded: false,
    meets: null,
    started_at: null,
    ended_at: null,
    verification: "",
    code: "",
    message: "",
    evidence: {},
    transaction: null,
    passed_by: null,
    halted_by: null,
    is_halt_certain: true,
    recovery_class: "R3",
    question: null,
    ...change,
  };
}

export function aRun(jobs: Job[], change: Partial<Run> = {}): Run {
  const ids = [...new Set(jobs.map((job) => job.step_id))];
  return {
    id: "run-1",
    number: 418,
    workflow: { id: "w", name: "Two transfers", version: 7 },
    mode: "sim",
    state: "running",
    created_by: "Li Na",
    created_at: iso(0),
    started_at: iso(0),
    ended_at: null,
    steps_total: ids.length,
    steps_done: 0,
    step_now: null,
    in_doubt_count: 0,
    estimate_s: 100,
    left_s: 50,
    pause_reasons: [],
    document: aDocument(),
    plan: {
      digest: "9f3a61c8",
      estimate_s: 100,
      steps: ids.map((id) => ({
        step_id: id,
        kind: "transfer",
        sentence: `Step ${id}`,
        estimate_s: 20,
      })),
      jobs: jobs.map((job) => aPlannedJob(job.index, job.step_id, job.after)),
      notes: [],
      proved: null,
    },
    jobs,
    approval: null,
    proof: null,
    waits_for: null,
    holds: [],
    files: [],
    recoveries: [],
    is_given_up: false,
    given_up: null,
    halts: [],
    execution: null,
    hosts_away: [],
    silent: [],
    contradicted: [],
    can: { pause: true, resume: false, abort: true, resolve: true, recover: true, confirm: true },
    ...change,
  };
}

/** A resource with that id, under that parent. */
export const aRow = (
  id: string,
  parent: string | null,
  change: Partial<ResourceRow> = {},
): ResourceRow => ({
  id,
  key: id,
  parent_id: parent,
  name: id,
  kind: "flask",
  kind_label: "Flask",
  nature: "resource",
  depth: 0,
  holds_liquid: true,
  contents: [],
  volume_nl: 0,
  capacity_nl: null,
  is_quarantined: false,
  is_archived: false,
  held_by: [],
  device: null,
  pose: null,
  ...change,
});

export function aDriver(changes: Partial<DriverRow> = {}): DriverRow {
  return {
    id: "v1",
    module: "drivers.virtual.timer",
    class_name: "HostTimer",
    role: "timer",
    digest: "ab12cd34".repeat(8),
    origin: "release",
    state: "approved",
    note: "",
    quality: "bronze",
    doc: "Waits.",
    proposed_by: null,
    proposed_at: null,
    approved_by: null,
    approved_at: null,
    read_at: "2026-11-01T00:00:00Z",
    devices: [],
    can: { read: true, decide: false, withdraw: false },
    ...changes,
  };
}

export function aPlace(changes: Partial<DriverPlace> = {}): DriverPlace {
  return {
    id: "d1",
    key: "timer_1",
    name: "Timer 1",
    state: "enrolled",
    host: { id: "h", name: "Bench 1", state: "online" },
    driver: {
      version_id: "v1",
      digest: "ab12cd34".repeat(8),
      class_name: "HostTimer",
      next: null,
      problem: null,
      serving: null,
    },
    job: null,
    can_change: true,
    ...changes,
  };
}
