/** What the report of a run is on the wire. */

import type { FileReading } from "./wirefiles";
import type { Id } from "./wirebase";
import type { LabEvent } from "./wirelab";

export interface AccountRow {
  /** `vessel`, or a nominal account such as REACTION. */
  account: string;
  resource_id: Id | null;
  name: string;
  mass_ug: number;
  lots: { lot: string; mass_ug: number }[];
}

export interface YieldRow {
  product: string;
  product_id: Id;
  material: string;
  basis: string;
  basis_umol: number | null;
  isolated_ug: number | null;
  isolated_umol: number | null;
  /** Null: something is not stated; `missing` names the lots. */
  ratio: number | null;
  missing: string[];
  stands_in: { id: Id; name: string }[];
}

export interface RunReport {
  taken: AccountRow[];
  brought: AccountRow[];
  taken_ug: number;
  brought_ug: number;
  gap_ug: number;
  unknown: string[];
  yields: YieldRow[];
  readings: FileReading[];
  doubts: { job_id: Id; sentence: string; resolved: LabEvent["resolved"] }[];
  unconfirmed: { job_id: Id; sentence: string; message: string }[];
}
