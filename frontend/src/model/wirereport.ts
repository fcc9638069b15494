/** What the report of a run is on the wire. */

import type { components } from "./api.gen";
import type { FileReading } from "./wirefiles";
import type { Id } from "./wirebase";
import type { LabEvent } from "./wirelab";

export type AccountRow = components["schemas"]["MassAccount"];

export type YieldRow = components["schemas"]["ProductYield"];

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
