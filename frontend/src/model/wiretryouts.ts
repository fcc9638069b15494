/** What crosses the border about drivers on trial; named as the server names it. */

import type { Id, Iso, Schema } from "./wirebase";

export interface SimulatedModel {
  model: string;
  title: string;
  carriers: string[];
  settings: Schema;
}

export interface TryoutHost {
  id: Id;
  name: string;
  problem: string | null;
  models: SimulatedModel[];
}

/** What all tryouts of one version have shown. */
export interface Tried {
  actions: string[];
  left_out: string[];
  failed: string[];
  statuses_were_read: boolean;
  faults: string[];
}

export interface TryoutRow {
  id: Id;
  host: { id: Id; name: string };
  model: string;
  title: string;
  speed: number;
  state: "starting" | "running" | "ended";
  code: string;
  message: string;
  begun_by: string;
  begun_at: Iso;
  ended_at: Iso | null;
}

export interface Tryouts {
  hosts: TryoutHost[];
  fastest: number;
  tried: Tried;
  tryouts: TryoutRow[];
}

export type WishSort = "act" | "read" | "stop" | "fault" | "cure" | "end";

export interface TryoutAct {
  number: number;
  sort: WishSort;
  name: string;
  args: Record<string, unknown>;
  asked_at: Iso;
  answered_at: Iso | null;
  code: string;
  message: string;
  effect: string;
  data: Record<string, unknown>;
  has_faults: boolean;
}

export interface WireRecord {
  n: number;
  at_s: number;
  /** `in`: towards the instrument. */
  direction: "in" | "out";
  hex: string;
}

export interface StatusReading {
  values?: Record<string, unknown>;
  problems?: Record<string, string>;
}

export interface Tryout extends TryoutRow {
  driver_id: Id;
  settings: Record<string, unknown>;
  config: Record<string, unknown>;
  faults_offered: Record<string, Schema>;
  faults: string[];
  statuses: StatusReading;
  acts: TryoutAct[];
  wire: WireRecord[];
  wire_left_out_count: number;
}

export interface TryoutWish {
  sort: WishSort;
  name?: string;
  args?: Record<string, unknown>;
}

export interface TryoutWanted {
  host_id: Id;
  model: string;
  settings: Record<string, unknown>;
  config: Record<string, unknown>;
  speed: number;
}
