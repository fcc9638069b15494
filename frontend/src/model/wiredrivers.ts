/** What crosses the border about drivers; named as the server names it. */

import type { DeviceAction, Id, Iso, Schema } from "./wirebase";
import type { Tried } from "./wiretryouts";

export type DriverStateName = "proposed" | "approved" | "rejected" | "withdrawn";

export interface DriverRow {
  id: Id;
  module: string;
  class_name: string;
  role: string;
  digest: string;
  origin: "release" | "upload";
  state: DriverStateName;
  note: string;
  quality: string;
  doc: string;
  proposed_by: string | null;
  proposed_at: Iso | null;
  approved_by: string | null;
  approved_at: Iso | null;
  read_at: Iso;
  devices: { id: Id; key: string; name: string }[];
  /** `read`: its source; who may not is given none. */
  can: { read: boolean; decide: boolean; withdraw: boolean };
}

/** What a driver declares. */
export interface DriverInterface {
  roles: string[];
  doc: string;
  quality: string;
  imports: string[];
  protocol: string;
  safe_state: string;
  actions: DeviceAction[];
  statuses: { name: string; label: string; doc: string; unit: string }[];
  config: Schema;
}

export interface DriverReading extends DriverInterface {
  module: string;
  class_name: string;
  digest: string;
  /** The version of this very source, if there is one. */
  known: { id: Id; state: DriverStateName } | null;
}

export interface DriverUse {
  version_id: Id;
  digest: string;
  class_name: string;
  next: { version_id: Id; digest: string; is_ready: boolean } | null;
  problem: { digest: string; code: string; message: string; at: Iso } | null;
  /** What its host said last of which version serves it; it may be that of before. */
  serving: { digest: string; at: Iso; host_id: Id; is_present: boolean } | null;
}

/** What a version makes of a device's parts: `decision` is handed back by who was shown it. */
export interface PartChanges {
  decision: string;
  changes: { code: string; message: string; subject: string }[];
  findings: { code: string; message: string; subject: string }[];
}

/** A device that has a version of the driver, or is to have it. */
export interface DriverPlace {
  id: Id;
  key: string;
  name: string;
  state: string;
  host: { id: Id; name: string; state: string };
  driver: DriverUse;
  job: { id: Id; run_id: Id; run_number: number; sentence: string } | null;
  can_change: boolean;
}

export interface DriverRequest {
  id: Id;
  state: string;
  asked_at: Iso;
  expires_at: Iso | null;
  decision: { is_approved: boolean; printed_name: string; comment: string; at: Iso } | null;
}

export interface DriverDetail extends DriverRow, Omit<DriverInterface, "doc" | "quality"> {
  sources: Record<string, string>;
  request: DriverRequest | null;
  places: DriverPlace[];
  tried: Tried;
}

export interface ChangedLine {
  sign: "" | "-" | "+";
  before: number | null;
  after: number | null;
  text: string;
}

export interface ModuleChange {
  module: string;
  is_new: boolean;
  is_gone: boolean;
  removed_count: number;
  added_count: number;
  hunks: ChangedLine[][];
}
