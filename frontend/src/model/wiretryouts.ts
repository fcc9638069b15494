/** What crosses the border about drivers on trial; named as the server names it. */

import type { components } from "./api.gen";
import type { Schema } from "./wirebase";

type Answers = components["schemas"];

export type SimulatedModel = Omit<Answers["TryoutModel"], "settings"> & { settings: Schema };
export type TryoutHost = Omit<Answers["TryoutHost"], "models"> & { models: SimulatedModel[] };
export type Tried = Answers["Tried"];
export type TryoutRow = Answers["TryoutRow"];
export type Tryouts = Omit<Answers["TryoutList"], "hosts" | "next"> & { hosts: TryoutHost[] };
export type WishSort = TryoutAct["sort"];
export type TryoutAct = Answers["TryoutActRow"];
export type WireRecord = Answers["TryoutBytes"];
export type StatusReading = Answers["TryoutStatuses"];
export type Tryout = Omit<Answers["TryoutDetail"], "faults_offered"> & {
  faults_offered: Record<string, Schema>;
};

export interface TryoutWish {
  sort: WishSort;
  name?: string;
  args?: Record<string, unknown>;
}

export interface TryoutWanted {
  host_id: string;
  model: string;
  settings: Record<string, unknown>;
  config: Record<string, unknown>;
  speed: number;
}
