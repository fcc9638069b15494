import { describe, expect, it } from "vitest";
import { EMPTY_PH, phOrderOf, whyNoPhOrder, type PhDraft } from "./calibrationph";

const buffer = {
  source_id: "a",
  standard: "borax",
  lot: " L-7 ",
  expanded: "0.02",
  due_on: "2027-01-01",
};
const [none] = EMPTY_PH.buffers.slice(2);
const whole: PhDraft = {
  ...EMPTY_PH,
  buffers: [buffer, { ...buffer, source_id: "b", standard: "phosphate" }, ...(none ? [none] : [])],
  pump_id: "p",
  vessel_id: "v",
  waste_id: "w",
  volume_ml: "5",
};

describe("an order to calibrate a probe", () => {
  it("needs two buffers whole; a third is left out or whole", () => {
    expect(whyNoPhOrder(EMPTY_PH)).toBe("Choose the pump.");
    expect(whyNoPhOrder(whole)).toBeNull();
    const [first, second] = whole.buffers;
    const third = { ...buffer, standard: "" };
    const begun = { ...whole, buffers: [first ?? buffer, second ?? buffer, third] };
    expect(whyNoPhOrder(begun)).toMatch(/buffer 3/);
    expect(whyNoPhOrder({ ...whole, volume_ml: "much" })).toMatch(/as numbers/);
  });

  it("is sent with microlitres and without the buffer that is not there", () => {
    const order = phOrderOf(whole);
    expect(order.volume_ul).toBe(5000);
    expect(order.buffers.map((one) => one.standard)).toEqual(["borax", "phosphate"]);
    expect(order.buffers[0]?.reference).toEqual({
      name: "Borax, pH 9.18",
      certificate: "L-7",
      expanded: 0.02,
      due_on: "2027-01-01",
    });
  });
});
