/** What crosses the border about approvals, resources, devices and hosts. */

import type { components } from "./api.gen";
import type { DeviceAction, Id, Iso, Plan } from "./wirebase";
import type { CalibrationChange } from "./wirecalibration";

type Answers = components["schemas"];

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

export type ApprovalRequest = components["schemas"]["ApprovalRow"];

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

export type Content = components["schemas"]["ContentRow"];

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

export type StockLot = components["schemas"]["StockLot"];

/** Whether one may take stock of a resource, and which lots it could hold. */
export type Stock = components["schemas"]["StockTaking"];

export type ReactionLot = components["schemas"]["ReactionLot"];

export type ReactionMaterial = components["schemas"]["ReactionMaterial"];

/** What a vessel holds, and of which materials a product may be. */
export type ReactionStock = components["schemas"]["ReactionStock"];

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

export type SearchHit = components["schemas"]["SearchHit"];

export type Reading = Answers["DeviceReading"];

/** A wish to halt one device, and what came of it. */
export type DeviceHalt = components["schemas"]["DeviceHaltRow"];

export type DeviceRow = Omit<Answers["DeviceRow"], "halt"> & { halt: DeviceHalt | null };

export type DevicePhoto = components["schemas"]["PhotoRow"];

export type Device = DeviceRow &
  Omit<Answers["DeviceDetail"], keyof DeviceRow | "actions" | "photo"> & {
    actions: DeviceAction[];
    photo: DevicePhoto | null;
  };

export type HostRow = Answers["HostRow"];
export type HostJob = Answers["HostJob"];

/** A host that works alone: of its jobs in a run only what was last heard is known. */
export type HostAway = components["schemas"]["HostAway"];

export type Host = Omit<Answers["HostDetail"], "devices"> & { devices: DeviceRow[] };

export type Sample = [status: string, at_s: number, value: number | string | boolean | null];

export type TwinInfo = Answers["TwinState"];
