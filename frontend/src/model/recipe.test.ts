import { expect, test } from "vitest";
import { comparePlans } from "./compareplans";
import {
  actionText,
  claimText,
  decodeRecipe,
  lineOf,
  linesOf,
  linksOf,
  routeText,
  sectionsOf,
} from "./recipe";
import { aPlan, aPlannedStep, aRig } from "./recipesamples";

const plain = (text: string): string => text.replaceAll("\u202f", " ");

test("a recipe is read in the encoding that it declares", () => {
  const latin = [...'<?xml version="1.0" encoding="ISO-8859-1"?>25 °C'].map((c) => c.charCodeAt(0));
  expect(decodeRecipe(new Uint8Array(latin))).toContain("25 °C");
  expect(decodeRecipe(new TextEncoder().encode("<XDL>25 °C</XDL>"))).toBe("<XDL>25 °C</XDL>");
  expect(decodeRecipe(new Uint8Array([255, 254, 60, 0, 88, 0]))).toContain("<X");
});

test("lines are counted as the server counts them", () => {
  expect(linesOf("a\r\nb\rc\nd")).toEqual(["a", "b", "c", "d"]);
  const finding = { code: "x", message: "m", subject: "", about: "recipe" as const };
  expect(lineOf({ ...finding, context: { line: 3, column: 1 } })).toBe(3);
  expect(lineOf({ ...finding, context: { path: "$.steps" } })).toBeNull();
});

test("claims and actions are sentences, with their amounts", () => {
  const transfer = { kind: "transfer", from: "a", to: "b", volume_ul: 5000, lot: "water" };
  expect(plain(claimText(transfer))).toBe("Move 5.00 mL of water from a to b");
  const all = { kind: "transfer", from: "a", to: "b", all: true, most_ul: 2000 };
  expect(plain(claimText(all))).toBe("Move all, at most 2.00 mL, from a to b");
  expect(plain(claimText({ kind: "add_solid", to: "r", lot: "salt", mass_ug: 3_060_000 }))).toBe(
    "Add 3.060 g of salt to r",
  );
  expect(plain(claimText({ kind: "stop_stir", vessel: "r" }))).toBe("Stop stirring r");
  expect(plain(claimText({ kind: "heat", vessel: "r", temperature_c: 35 }))).toBe(
    "Heat or chill r to 35 °C",
  );
  expect(plain(claimText({ kind: "rotate", vessel: "r", speed_rpm: 250 }))).toBe(
    "Rotate r: speed 250 rpm",
  );
  const draw = { device: "p", action: "aspirate", parameters: { volume_ul: 250, rate_ul_s: 10 } };
  expect(plain(actionText(draw))).toBe("aspirate: volume 0.25 mL, rate 10 µL/s");
  const fill = { device: "@by_hand", action: "fill", parameters: { text: "Fill it", vessel: "a" } };
  expect(actionText(fill)).toBe("Fill it");
});

test("steps of the plan stand under the step of the recipe that they come from", () => {
  const plan = aPlan([
    aPlannedStep({ id: 1, of: { operation: "Prepare", act: 0 } }),
    aPlannedStep({ id: 2, of: { operation: "Add", act: 1, line: 4 } }),
    aPlannedStep({ id: 3, of: { operation: "Add", act: 1, line: 4 } }),
    aPlannedStep({ id: 4, of: { operation: "Add", act: 2, line: 5 } }),
  ]);
  const found = sectionsOf(plan);
  expect(found.map((one) => [one.operation, one.line, one.steps.length, one.estimate_s])).toEqual([
    ["Prepare", null, 1, 10],
    ["Add", 4, 2, 20],
    ["Add", 5, 1, 10],
  ]);
});

test("two links between the same nodes are one line, and a route names each tube once", () => {
  const rig = aRig();
  expect(linksOf(rig).map((link) => link.tubes.length)).toEqual([2, 1]);
  expect(routeText(rig, ["1", "2"])).toEqual(["pump port 0 – valve port -1"]);
});

const before = { plan: aPlan([aPlannedStep({})]), rig: aRig() };

test("the same step in vessels of other names is no difference", () => {
  const rig = aRig();
  rig.nodes = rig.nodes.map((node) => (node.key === "flask" ? { ...node, key: "bottle_7" } : node));
  const step = aPlannedStep({});
  const moved = { ...step, does: { ...step.does, from: "bottle_7" } };
  const plan = aPlan([moved]);
  plan.bindings = { ...plan.bindings, reagents: { water: "bottle_7" } };
  const found = comparePlans(before, { plan, rig });
  expect([found.steps, found.same_count]).toEqual([[], 1]);
});

test("a step by other devices, of another amount, added and left out are told apart", () => {
  const step = aPlannedStep({});
  const slow = aPlan([{ ...step, estimate_s: 99 }]);
  expect(comparePlans(before, { ...before, plan: slow }).steps.map((s) => s.sign)).toEqual(["="]);
  const more = aPlan([{ ...step, does: { ...step.does, volume_ul: 9 } }]);
  expect(comparePlans(before, { ...before, plan: more }).steps.map((s) => s.sign)).toEqual(["~"]);
  const other = aPlan([{ ...step, does: { kind: "wait", duration_s: 3 } }]);
  expect(comparePlans(before, { ...before, plan: other }).steps.map((s) => s.sign)).toEqual([
    "−",
    "+",
  ]);
});

test("amounts of either plan are compared, a missing one with nothing", () => {
  const plan = aPlan([]);
  plan.totals = { ...plan.totals, needed_ul: { ether: 5 } };
  expect(comparePlans(before, { ...before, plan }).needed_ul).toEqual([
    { name: "ether", before: 0, after: 5 },
    { name: "water", before: 5000, after: 0 },
  ]);
});
