/** What crosses the border about kept files and readings. */

import type { components } from "./api.gen";
import type { Finding, Refined } from "./wirebase";

type Answers = components["schemas"];

export type KeptFile = Answers["KeptFile"];

export type FileState = "awaited" | "pending" | "parsed" | "refused" | "lost";

/** A file that an action of a run has measured, whether its bytes are here or not. */
export type RunFile = Answers["JobFile"];

/** A file that waits to be read, or what became of it. */
export type IncomingFile = Refined<Answers["IncomingRow"], { findings: Finding[] }>;

export type FileRow = Answers["FileRow"];

export type Axis = Answers["SeriesAxis"];

export type FileReading = Answers["ReadingRow"];

export type FileDetail = Answers["FileDetail"];

export type Drawn = Answers["DrawnSeries"];
