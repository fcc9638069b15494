/** What the report of a run is on the wire. */

import type { components } from "./api.gen";

type Answers = components["schemas"];

export type AccountRow = Answers["MassAccount"];

export type YieldRow = Answers["ProductYield"];

export type RunReport = Answers["RunReport"];
