import { expect, test } from "vitest";
import { fieldOf, ringOf, ringStates, sortFindings } from "./findings";
import type { Finding } from "./wire";

const finding = (code: string, subject = "", field = ""): Finding => ({
  code,
  message: code,
  subject,
  context: field ? { field } : {},
});

test("findings are read ring by ring, then in the order of the steps", () => {
  const sorted = sortFindings(
    [
      finding("plan.no_route", "a"),
      finding("crutd.capacity_exceeded", "b"),
      finding("protocol.cycle", "b", "edges"),
      finding("unit.unknown", "b", "params.volume"),
      finding("protocol.missing_param", "a", "params.target"),
    ],
    ["a", "b"],
  );
  expect(sorted.map((item) => item.code)).toEqual([
    "protocol.missing_param",
    "unit.unknown",
    "protocol.cycle",
    "crutd.capacity_exceeded",
    "plan.no_route",
  ]);
});

test("a finding names its field", () => {
  expect(fieldOf(finding("unit.unknown", "a", "params.volume"))).toBe("volume");
  expect(fieldOf(finding("plan.no_route", "a"))).toBeNull();
});

test("each code belongs to one ring", () => {
  expect(ringOf(finding("contents.insufficient"))).toBe("materials");
  expect(ringOf(finding("plan.no_device"))).toBe("resources");
});

test("rings that could not be asked are waiting, not good", () => {
  const bad = ringStates([finding("unit.unknown", "a", "params.volume")], false, true);
  expect(bad).toMatchObject({
    fields: "bad",
    graph: "ok",
    materials: "waiting",
    resources: "waiting",
  });
  expect(ringStates([], true, true)).toMatchObject({
    materials: "ok",
    resources: "ok",
  });
  expect(ringStates([], false, false).fields).toBe("waiting");
});
