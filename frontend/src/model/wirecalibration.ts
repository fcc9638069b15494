/** Calibrations as the server tells of them. */

import type { components } from "./api.gen";
import type { Finding } from "./wirebase";

type Answers = components["schemas"];

export type CalibrationState =
  "measuring" | "failed" | "awaiting" | "accepted" | "rejected" | "withdrawn";

export type Standing = "in_force" | "expired" | "changed" | "withdrawn";

export type LevelResult = Answers["LevelResult"];

export interface CalibrationResult {
  gain: number;
  offset: number;
  gain_expanded: number;
  levels: LevelResult[];
  slope_pct: number | null;
  offset_mv: number | null;
}

export interface CalibrationPoint {
  level: number;
  indicated: number;
  reference: number;
  at_s: number;
}

export type Reference = Answers["Reference"];

export interface Calibration {
  id: string;
  device_id: string;
  quantity: string;
  number: number;
  state: CalibrationState;
  standing: Standing | null;
  reasons: string[];
  run: { id: string; number: number; state: string };
  /** Every standard that it was compared with. */
  references: Reference[];
  tolerance: number;
  valid_days: number;
  points: CalibrationPoint[];
  result: CalibrationResult | null;
  findings: Finding[];
  made_by: string;
  made_at: string;
  measured_at: string | null;
  decided_by: string | null;
  decided_at: string | null;
  comment: string;
  expires_at: string | null;
  withdrawn_by: string | null;
  withdrawn_at: string | null;
  withdrawn_because: string;
  /** The request that waits for a second person; null: none does. */
  request_id: string | null;
  can: { withdraw: boolean };
}

export interface CalibratedQuantity {
  quantity: string;
  unit: string;
  /** Its uncertainty is a share of the value; else in the unit. */
  is_relative: boolean;
  may_begin: boolean;
  /** What the maker states; null: nothing. */
  stated: { ratio: number | null; absolute: number | null } | null;
  /** Id of the newest that was ever accepted. */
  newest: string | null;
  history: Calibration[];
}

/** What a decision changes: the calibration that holds now, and the one that waits. */
export interface CalibrationChange {
  device: { id: string; name: string };
  quantity: string;
  unit: string;
  is_relative: boolean;
  becomes: Calibration;
  /** Null: the device was never calibrated. */
  was: Calibration | null;
}

export interface PhOrder {
  buffers: { source_id: string; standard: string; reference: Reference }[];
  vessel_id: string;
  waste_id: string;
  pump_id: string;
  volume_ul: number;
  repeats: number;
  tolerance: number;
  valid_days: number;
}

export interface TemperatureOrder {
  vessel_id: string;
  thermometer_id: string;
  reference: Reference;
  set_points_c: number[];
  settle_s: number;
  repeats: number;
  /** Null: nothing stirs. */
  stir_speed_rpm: number | null;
  tolerance: number;
  valid_days: number;
}

export interface VolumeOrder {
  source_id: string;
  target_id: string;
  balance_id: string;
  around: { water_c: number; pressure_kpa: number; humidity_ratio: number };
  reference: Reference;
  repeats: number;
  tolerance: number;
  valid_days: number;
}
