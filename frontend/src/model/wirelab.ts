/** What crosses the border about approvals, resources, devices and hosts. */

import type { components } from "./api.gen";
import type { DeviceAction, Id, Iso, JobState, Plan } from "./wirebase";
import type { CalibrationChange } from "./wirecalibration";
import type { DriverUse } from "./wiredrivers";

export interface LabEvent {
  seq: number;
  at: Iso;
  operation: "create" | "read" | "update" | "transfer" | "delete";
  state: string;
  verification: string;
  subjects: { id: Id; name: string; role: string }[];
  amount_nl: number | null;
  /** Of what is moved by mass: a solid, or what goes along with a liquid. */
  amount_ug: number | null;
  summary: string;
  job_id: Id | null;
  run: { id: Id; number: number } | null;
  code: string;
  message: string;
  transaction_id: Id | null;
  /** Of an event that left a doubt: how that ended; null: it is open, or there was none. */
  resolved: { text: string; note: string; at: Iso; doubt_at: Iso } | null;
}

export interface LogLine {
  at: Iso;
  job_id: Id | null;
  job_index: number | null;
  kind: string;
  text: string;
  body: unknown;
}

export interface ApprovalRequest {
  id: Id;
  title: string;
  state: string;
  about: "run" | "calibration";
  /** The run that waits for it, or that measured. */
  run: { id: Id; number: number };
  workflow: { id: Id; name: string; version: number };
  policies: string[];
  asked_by: { name: string };
  asked_at: Iso;
  expires_at: Iso | null;
  plan_digest: string;
  can_decide: boolean;
  why_not: string | null;
  decision: {
    is_approved: boolean;
    printed_name: string;
    meaning: string;
    comment: string;
    at: Iso;
  } | null;
}

export interface CalibrationApproval extends ApprovalRequest {
  about: "calibration";
  calibration: CalibrationChange;
}

export type ApprovalDetail = RunApproval | CalibrationApproval;

export interface RunApproval extends ApprovalRequest {
  about: "run";
  plan: Plan;
  materials: { id: Id; name: string; before_nl: number; after_nl: number }[];
}

export interface Content {
  lot_id: Id;
  lot: string;
  material: string;
  amount_nl: number;
  /** Solids and gases are counted by mass. */
  amount_ug: number;
}

export interface ResourceRow {
  id: Id;
  key: string;
  parent_id: Id | null;
  name: string;
  kind: string;
  kind_label: string;
  nature: string;
  depth: number;
  holds_liquid: boolean;
  contents: Content[];
  volume_nl: number;
  capacity_nl: number | null;
  is_quarantined: boolean;
  is_archived: boolean;
  /** The runs that keep it for themselves; several where they only draw from it. */
  held_by: { run_id: Id; run: number; until_step: number; is_shared: boolean }[];
  device: { id: Id; name: string } | null;
  pose: Record<string, unknown> | null;
}

/** All of a connection as it is shown; it is taken off only while it still is so. */
export interface SeenConnection {
  connection_id: Id;
  key: string;
  source_id: Id;
  source_port: string;
  target_id: Id;
  target_port: string;
  medium: string;
}

export interface Resource extends ResourceRow {
  config: Record<string, unknown>;
  data: Record<string, unknown>;
  /** By field of `data`: how it is known, since when, and by which job; null: by no job. */
  data_told: Record<string, { how: "set" | "measured" | "unknown"; at: Iso; job_id: Id | null }>;
  extra: Record<string, unknown>;
  size_mm: unknown;
  ports: {
    port: string;
    to: { id: Id; name: string; port: string } | null;
    medium: string;
    connection: SeenConnection;
    may_disconnect: boolean;
  }[];
  events: LabEvent[];
  events_next: string | null;
}

/** Which edge host writes a vessel's facts, and the move it is on. */
export interface Custody {
  host: { id: Id; name: string } | null;
  move: {
    id: Id;
    state: string;
    from: { id: Id; name: string } | null;
    to: { id: Id; name: string } | null;
    place: { id: Id; name: string } | null;
    asked_by: string | null;
    asked_at: Iso;
    released_at: Iso | null;
    is_told: boolean;
  } | null;
  /** What keeps it where it is: it is not carried before these are off. */
  connections: { key: string; medium: string; to: string }[];
  is_allowed: boolean;
  /** Kinds of resource that carry others. */
  /** Of a kind that takes it; each with why there is no room for it now. */
  places: { id: Id; why_not: string | null }[];
}

/** Exclusive use of a resource in the near future; the time ends it. */
export type Reservation = components["schemas"]["ReservationRow"];

/** Reservations of a resource and of what it stands in, in the order of asking. */
export interface Reservations {
  is_allowed: boolean;
  reservations: Reservation[];
}

export interface StockLot {
  lot_id: Id;
  lot: string;
  material: string;
  /** Liquids are counted in nanolitres, solids and gases in micrograms. */
  unit: "nl" | "ug";
}

/** Whether one may take stock of a resource, and which lots it could hold. */
export interface Stock {
  is_allowed: boolean;
  why_not: string | null;
  lots: StockLot[];
}

export interface ReactionLot extends StockLot {
  amount: number;
  density_mg_ul: number | null;
}

export interface ReactionMaterial {
  id: Id;
  name: string;
  density_mg_ul: number | null;
}

/** What a vessel holds, and of which materials a product may be. */
export interface ReactionStock {
  is_allowed: boolean;
  lots: ReactionLot[];
  materials: ReactionMaterial[];
}

export interface Ticket {
  id: Id;
  code: string;
  message: string;
  detail: Record<string, unknown>;
  resources: { id: Id; name: string; is_quarantined: boolean }[];
  host: { id: Id; name: string } | null;
  opened_at: Iso;
  closed_at: Iso | null;
  closed_by: string | null;
  can_close: boolean;
}

export interface LineageNode {
  id: Id;
  kind: "entity" | "activity";
  type: string;
  name: string;
  detail: string;
  at: Iso | null;
}

export interface Lineage {
  root: Id;
  nodes: LineageNode[];
  edges: { source: Id; target: Id; amount_nl: number | null; at: Iso | null; label: string }[];
  truncated: number;
}

export interface SearchHit {
  kind: string;
  id: Id;
  name: string;
  detail: string;
  url: string;
}

export interface Reading {
  status: string;
  label: string;
  unit: string;
  value: number | string | boolean | null;
  at_s: number | null;
}

/** A wish to halt one device, and what came of it. */
export interface DeviceHalt {
  id: Id;
  device: { id: Id; name: string };
  state: "asked" | "taken" | "owed" | "halted" | "kept" | "lost";
  message: string;
  at: Iso;
  ended_at: Iso | null;
  /** Run that was aborted; null: a person stopped the device. */
  run: { id: Id; number: number } | null;
  by: string | null;
}

export interface DeviceRow {
  id: Id;
  key: string;
  name: string;
  role: string;
  kind_label: string;
  host: { id: Id; name: string } | null;
  state: string;
  link: "online" | "stale" | "offline" | "not_enrolled" | "quarantined";
  /** Nothing begins on it before its host has halted it. */
  is_halt_owed: boolean;
  /** The halt that was asked for last and is not delivered; of one device alone, however it ended. */
  halt: DeviceHalt | null;
  job: { id: Id; run_id: Id; run_number: number; sentence: string; state: JobState } | null;
  readings: Reading[];
}

export type DevicePhoto = components["schemas"]["PhotoRow"];

export interface Device extends DeviceRow {
  driver: (DriverUse & { protocol: string; quality: string; doc: string }) | null;
  actions: DeviceAction[];
  /** It can show which one it is, on a display or by a light. */
  shows_itself: boolean;
  statuses: { name: string; label: string; unit: string; doc: string }[];
  config: Record<string, unknown>;
  nodes: { role: string; id: Id; name: string }[];
  transport: unknown;
  photo: DevicePhoto | null;
}

export interface HostRow {
  id: Id;
  key: string;
  name: string;
  state: string;
  last_seen_at: Iso | null;
  epoch: number;
  acked_seq: number;
  journal_lag: number;
  devices_count: number;
  state_at: Iso | null;
  away_since_at: Iso | null;
  /** Host's wall clock less the server's, seconds; shown, never decided by. */
  clock_skew_s: number | null;
  heartbeat: Record<string, unknown> | null;
  /** The disk with its journal, as it said last; null: it has not said. The text warns. */
  disk: { free_bytes: number; level: "ok" | "low" | "full"; text: string } | null;
}

export interface HostJob {
  id: Id;
  run_id: Id;
  run_number: number;
  sentence: string;
  state: string;
  state_at: Iso | null;
}

/** A host that works alone: of its jobs in a run only what was last heard is known. */
export interface HostAway {
  id: Id;
  name: string;
  since_at: Iso | null;
  jobs_count: number;
  job_ids: Id[];
}

export interface Host extends HostRow {
  floor: number;
  last_dseq: number;
  epoch_seen: number;
  journal_id: Id | null;
  reason: { code: string; message: string } | null;
  devices: DeviceRow[];
  jobs: HostJob[];
  tickets: { id: Id; code: string; message: string; opened_at: Iso }[];
  /** Vessels on their way from or to this host. */
  moves: {
    id: Id;
    name: string;
    place: string | null;
    state: string;
    is_leaving: boolean;
    at: Iso;
  }[];
  fence: { first_by: string; first_at: Iso; reason: string; is_mine: boolean } | null;
  can: { fence: boolean; readmit: boolean; revoke: boolean };
}

export type Sample = [status: string, at_s: number, value: number | string | boolean | null];

export interface TwinInfo {
  state: "online" | "offline";
  url: string;
}
