/** What crosses the border about kept files and readings. */

import type { components } from "./api.gen";
import type { Finding, Id, Iso } from "./wirebase";

type Answers = components["schemas"];

interface Named {
  id: Id;
  name: string;
}

export interface KeptFile {
  id: Id;
  name: string;
  media_type: string;
  format: string;
  size_bytes: number;
  sha256: string;
  kept_by: string;
  kept_at: Iso;
}

export type FileState = "awaited" | "pending" | "parsed" | "refused" | "lost";

/** A file that an action of a run has measured, whether its bytes are here or not. */
export type RunFile = Answers["JobFile"];

/** A file that waits to be read, or what became of it. */
export interface IncomingFile {
  id: Id;
  name: string;
  format: string;
  size_bytes: number;
  state: FileState;
  file_id: Id | null;
  code: string;
  message: string;
  findings: Finding[];
  brought_by: string;
  brought_at: Iso;
}

export interface FileRow extends KeptFile {
  resource: Named | null;
  device: Named | null;
  job: { id: Id; index: number; sentence: string; run: { id: Id; number: number } } | null;
}

export type Axis = Answers["SeriesAxis"];

export interface FileReading {
  id: Id;
  index: number;
  name: string;
  quantity: string;
  unit: string;
  value: number | null;
  text: string;
  series_file_id: Id | null;
  series: (Axis & { axes: Axis[] }) | null;
  measured_at: Iso | null;
}

export interface FileDetail extends FileRow {
  facts: Record<string, unknown>;
  readings: FileReading[];
  readings_count: number;
  series: KeptFile[];
}

export type Drawn = Answers["DrawnSeries"];
