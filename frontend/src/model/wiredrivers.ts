/** What crosses the border about drivers; named as the server names it. */

import type { components } from "./api.gen";
import type { DeviceAction, Refined, Schema } from "./wirebase";

type Answers = components["schemas"];

/** Fields whose content is an open document to the schema. */
interface Open {
  actions: DeviceAction[];
  config: Schema;
}

export type DriverStateName = DriverRow["state"];
export type DriverRow = Answers["DriverRow"];
export type DriverReading = Refined<Answers["DriverReading"], Open>;

/** What a driver declares. */
export type DriverInterface = Omit<DriverReading, "module" | "class_name" | "digest" | "known">;

export type DriverUse = Answers["DriverUse"];
export type PartChanges = Answers["DriverPartChanges"];
export type DriverPlace = Answers["DriverPlace"];
export type DriverRequest = Answers["DriverRequest"];
export type DriverDetail = Refined<Answers["DriverDetail"], Open>;
export type ChangedLine = Answers["ChangedLine"];
export type ModuleChange = Answers["ModuleChange"];
