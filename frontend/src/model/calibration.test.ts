import { describe, expect, it } from "vitest";
import {
  calibrationState,
  daysLeft,
  dueWords,
  EMPTY,
  levelRows,
  orderOf,
  residualPlot,
  signedText,
  whyNoOrder,
  worst,
} from "./calibration";
import { calibration } from "./calibrationsamples";

const VOLUME = { is_relative: true, unit: "µL" };

describe("a calibration", () => {
  it("says how far a pump was off, what is left and how sure that is, by level", () => {
    const [low, , high] = levelRows(calibration(), VOLUME);
    expect(signedText(low?.found ?? 0, VOLUME)).toBe("−3.00\u202f%");
    expect(high?.left).toBeCloseTo(0.0001, 5);
    expect(worst(calibration(), VOLUME)).toBeCloseTo(0.003, 6);
  });

  it("places what is left between the limits that were asked for", () => {
    const plot = residualPlot(calibration(), VOLUME);
    expect(plot?.dots).toHaveLength(3);
    for (const dot of plot?.dots ?? []) {
      expect(dot.y).toBeGreaterThan(plot?.limits[0] ?? 1);
      expect(dot.y).toBeLessThan(plot?.limits[1] ?? 0);
    }
  });

  it("reaches as far as its worst point", () => {
    const bad = calibration({
      points: [{ level: 1, indicated: 100, reference: 90, standard: 0, at_s: 0 }],
    });
    expect(residualPlot(bad, VOLUME)?.reach).toBeGreaterThan(0.07);
  });

  it("is superseded by a newer one, whatever its own standing", () => {
    expect(calibrationState(calibration(), true).word).toBe("In force");
    expect(calibrationState(calibration(), false).word).toBe("Superseded");
    expect(calibrationState(calibration({ standing: "expired" }), true).look).toBe("needs");
  });

  it("does not pass with a finding, and waits for nobody to accept it", () => {
    const finding = { code: "calibration.drift", message: "drifts", subject: "", context: {} };
    const waiting = calibration({ state: "awaiting", standing: null });
    expect(calibrationState(waiting, false).word).toBe("Awaits a second person");
    expect(calibrationState({ ...waiting, findings: [finding] }, false).look).toBe("error");
  });

  it("gives no sign to what rounds to nothing", () => {
    expect(signedText(0.000004, VOLUME)).toBe("0.00\u202f%");
    expect(signedText(0.000014, VOLUME, 3)).toBe("+0.001\u202f%");
  });

  it("counts whole days to its due date", () => {
    expect(daysLeft("2027-01-02T00:00:00Z", Date.parse("2027-01-01T00:00:00Z") / 1000)).toBe(1);
    expect([-3, -1, 0, 1, 9].map(dueWords)).toEqual([
      "3 days ago",
      "since yesterday",
      "today",
      "tomorrow",
      "in 9 days",
    ]);
  });
});

describe("an order", () => {
  const whole = {
    ...EMPTY,
    source_id: "a",
    target_id: "b",
    balance_id: "c",
    water_c: "21.5",
    pressure_kpa: "101.3",
    certificate: " D-K-1 ",
    expanded: "0.4",
    due_on: "2027-05-01",
  };

  it("names the first thing that is missing", () => {
    expect(whyNoOrder(EMPTY)).toBe("Choose the vessel with water.");
    expect(whyNoOrder({ ...whole, water_c: "warm" })).toBe(
      "Write the temperature of the water as a number.",
    );
    expect(whyNoOrder({ ...whole, due_on: "soon" })).toMatch(/until when/);
    expect(whyNoOrder(whole)).toBeNull();
  });

  it("is sent with shares for percent", () => {
    const order = orderOf(whole, "Balance 1");
    expect(order.tolerance).toBeCloseTo(0.005);
    expect(order.around.humidity_ratio).toBeCloseTo(0.5);
    expect(order.reference).toEqual({
      name: "Balance 1",
      certificate: "D-K-1",
      expanded: 0.4,
      due_on: "2027-05-01",
    });
  });
});
