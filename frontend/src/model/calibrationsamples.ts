/** A calibration for tests. */

import type { Calibration } from "./wirecalibration";

const LEVELS = [500, 2500, 5000];

export function calibration(changes: Partial<Calibration> = {}): Calibration {
  return {
    id: "c1",
    device_id: "d1",
    quantity: "volume",
    number: 2,
    state: "accepted",
    standing: "in_force",
    reasons: [],
    run: { id: "r1", number: 12, state: "complete" },
    references: [{ name: "Balance 1", certificate: "D-K-1", expanded: 0.4, due_on: "2027-05-01" }],
    tolerance: 0.005,
    valid_days: 365,
    points: LEVELS.map((level) => ({
      level,
      indicated: level,
      reference: level * 0.9699,
      standard: 0,
      at_s: 0,
    })),
    result: {
      quantity: "volume",
      gain: 0.97,
      offset: 0,
      gain_expanded: 0.0002,
      offset_expanded: 0,
      covariance: 0,
      findings: [],
      slope_pct: null,
      offset_mv: null,
      levels: LEVELS.map((level) => ({
        level,
        count: 3,
        indicated: level,
        reference: level * 0.97,
        error: level * 0.03,
        residual: level * 0.0001 * 0.97,
        repeatability: 0.2,
        expanded: level * 0.97 * 0.003,
      })),
    },
    findings: [],
    made_by: "Ada Chemist",
    made_at: "2026-11-20T10:00:00Z",
    measured_at: "2026-11-20T10:30:00Z",
    decided_by: "Ben Approver",
    decided_at: "2026-11-20T11:00:00Z",
    comment: "",
    expires_at: "2027-11-20T10:30:00Z",
    withdrawn_by: null,
    withdrawn_at: null,
    withdrawn_because: "",
    request_id: null,
    can: { withdraw: false },
    ...changes,
  };
}
