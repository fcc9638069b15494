/** Calibrations as the server tells of them. */

import type { components } from "./api.gen";
import type { Finding, Refined } from "./wirebase";

type Answers = components["schemas"];

export type CalibrationState =
  "measuring" | "failed" | "awaiting" | "accepted" | "rejected" | "withdrawn";

export type Standing = "in_force" | "expired" | "changed" | "withdrawn";

export type LevelResult = Answers["LevelResult"];

export type CalibrationResult = Answers["CalibrationResult"];

export type CalibrationPoint = Answers["CalibrationPoint"];

export type Reference = Answers["Reference"];

export type Calibration = Refined<Answers["CalibrationDetail"], { findings: Finding[] }>;

export type CalibratedQuantity = Refined<Answers["CalibratedQuantity"], { history: Calibration[] }>;

/** What a decision changes: the calibration that holds now, and the one that waits. */
export type CalibrationChange = Refined<
  Answers["CalibrationChange"],
  { becomes: Calibration; was: Calibration | null }
>;

export type PhOrder = Refined<Answers["PhOrder"], { settle_s?: number }>;

export type TemperatureOrder = Answers["TemperatureOrder"];

export type VolumeOrder = Answers["VolumeOrder"];
