import { describe, expect, it } from "vitest";
import { EMPTY_HEAT, heatOrderOf, setPointsOf, whyNoHeatOrder } from "./calibrationheat";

const whole = {
  ...EMPTY_HEAT,
  vessel_id: "v",
  thermometer_id: "t",
  certificate: " K-1 ",
  expanded: "0.1",
  due_on: "2099-01-01",
  set_points: "30, 55 80",
};

describe("an order to calibrate a heater", () => {
  it("says what is missing, one after the other", () => {
    expect(whyNoHeatOrder(EMPTY_HEAT)).toBe("Choose the vessel that is heated.");
    expect(whyNoHeatOrder(whole)).toBeNull();
    expect(whyNoHeatOrder({ ...whole, certificate: " " })).toMatch(/certificate/);
    expect(whyNoHeatOrder({ ...whole, set_points: "30, 55" })).toMatch(/three set points/);
    expect(whyNoHeatOrder({ ...whole, set_points: "30, 55, hot" })).toMatch(/three set points/);
    expect(whyNoHeatOrder({ ...whole, stir_rpm: "fast" })).toMatch(/stirred/);
  });

  it("is sent with seconds, and without a stirrer where none is asked for", () => {
    const order = heatOrderOf(whole, "pH 1");
    expect(order).toMatchObject({
      set_points_c: [30, 55, 80],
      settle_s: 300,
      stir_speed_rpm: null,
    });
    expect(order.reference).toEqual({
      name: "pH 1",
      certificate: "K-1",
      expanded: 0.1,
      due_on: "2099-01-01",
    });
    expect(heatOrderOf({ ...whole, stir_rpm: "300" }, "pH 1").stir_speed_rpm).toBe(300);
  });

  it("reads set points with any of the usual signs between", () => {
    expect(setPointsOf(" 30; 55,80 ")).toEqual([30, 55, 80]);
    expect(setPointsOf("")).toEqual([]);
  });
});
