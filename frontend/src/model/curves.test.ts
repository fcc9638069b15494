import { expect, test } from "vitest";
import {
  bandColumns,
  drawable,
  gapWords,
  levelDrawn,
  readableUnit,
  roomy,
  stepWords,
  whyNoRange,
  withLive,
  type Curve,
} from "./curves";

const curve = (more: Partial<Curve> = {}): Curve => ({
  status: "temperature_c",
  label: "Temperature",
  unit: "°C",
  every_s: 1,
  level_s: 1,
  step_s: 2,
  points: [
    [0, 20, 19, 21, 2],
    [2, 22, 21, 23, 2],
    [20, 30, 29, 31, 2],
  ],
  ...more,
});

test("a bucket is drawn in its middle, and a missing one breaks the curve", () => {
  const [at, mean, low, high] = bandColumns(curve(), null, []);
  expect(at).toEqual([1, 3, 12, 21]);
  expect(mean).toEqual([20, 22, null, 30]);
  expect(low).toEqual([19, 21, null, 29]);
  expect(high).toEqual([21, 23, null, 31]);
});

test("a recorded gap between two points breaks the curve, however short it is", () => {
  const samples = curve({
    step_s: 0,
    level_s: 0,
    points: [
      [0, 1],
      [1, 2],
      [2, 3],
    ],
  });
  expect(bandColumns(samples, null, [])[1]).toEqual([1, 2, 3]);
  const gap = { since: 1, until: 2, lost_count: 4, reason: "overflow" };
  expect(bandColumns(samples, null, [gap])[1]).toEqual([1, 2, null, 3]);
});

test("a slow status is no row of gaps", () => {
  const slow = curve({
    every_s: 30,
    points: [
      [0, 1, 1, 1, 1],
      [30, 1, 1, 1, 1],
    ],
  });
  expect(bandColumns(slow, null, [])[1]).toEqual([1, 1]);
});

test("text and yes-or-no are no curves, and a setpoint goes with what it is for", () => {
  const set = curve({ status: "temperature_setpoint_c", step_s: 0, points: [[0, 60]] });
  const mode = curve({
    status: "mode",
    step_s: 0,
    points: [
      [0, "idle"],
      [1, true],
    ],
  });
  const found = drawable([mode, set, curve({ status: "speed_rpm" }), curve()]);
  expect(found.map((one) => one.curve.status)).toEqual(["temperature_c", "speed_rpm"]);
  expect(found[0]?.set?.status).toBe("temperature_setpoint_c");
  expect(bandColumns(curve(), set, [])[4]).toEqual([60, 60, 60, 60]);
});

test("live samples go on where the fetched ones end", () => {
  const [grown] = withLive(
    [curve()],
    [
      ["temperature_c", 21, 1],
      ["temperature_c", 23, 40],
      ["other", 24, 50],
    ],
  );
  const [at, mean] = bandColumns(grown ?? curve(), null, []);
  expect([at.at(-1), mean.at(-1)]).toEqual([23, 40]);
  expect(at).toHaveLength(5);
});

test("a range says what is wrong with it", () => {
  expect(whyNoRange("2026-01-01T00:00:00Z", "2026-01-02T00:00:00Z")).toBeNull();
  expect(whyNoRange("2026-01-02T00:00:00Z", "2026-01-02T00:00:00Z")).toMatch(/after/);
  expect(whyNoRange(null, "2026-01-02T00:00:00Z")).toMatch(/both/);
});

test("words of steps, gaps and units", () => {
  expect(stepWords(curve({ step_s: 0 }))).toBe("");
  expect([4, 660, 7200].map((step_s) => stepWords(curve({ step_s })))).toEqual([
    "mean of 4 s",
    "mean of 11 min",
    "mean of 2 h",
  ]);
  const gap = { since: 0, until: 1, lost_count: 3, reason: "overflow" };
  expect(gapWords([])).toBe("");
  expect(gapWords([gap])).toBe("1 recorded gap, 3 samples lost");
  expect(gapWords([gap, { ...gap, lost_count: null }])).toMatch(/at least 3/);
  expect(gapWords([{ ...gap, lost_count: null }])).toBe(
    "1 recorded gap; how many samples were lost is not known",
  );
  expect(gapWords([{ ...gap, lost_count: 1 }])).toBe("1 recorded gap, 1 sample lost");
  expect(levelDrawn([curve({ level_s: 60 }), curve({ level_s: 0 })])).toBe("1min");
  expect(levelDrawn([])).toBe("1s");
  expect(readableUnit(curve({ unit: "µL", points: [[0, 4000, 4000, 4000, 1]] }))).toEqual([
    "mL",
    0.001,
  ]);
  expect(readableUnit(curve({ unit: "µL", points: [[0, 40, 40, 40, 1]] }))).toEqual(["µL", 1]);
});

test("what is drawn has a window with air, which does not go below zero for nothing", () => {
  const [low, high] = roomy(20, 60);
  expect([low < 20, high > 60]).toEqual([true, true]);
  expect(roomy(-3, -3)[0]).toBeLessThan(-3);
  expect(roomy(0, 0)[0]).toBeCloseTo(-0.08);
  expect(roomy(0, 0)[1]).toBeGreaterThanOrEqual(1);
  expect(roomy(0.2, 0.3)[0]).toBeCloseTo(-0.08);
  expect(roomy(null, null)).toEqual([0, 1]);
});

test("yes and no are drawn as the share of yes, after the numbers", () => {
  const said = curve({
    status: "is_open",
    unit: "",
    is_share: true,
    level_s: 0,
    step_s: 0,
    points: [
      [0, true],
      [1, false],
      [2, "maybe"],
    ],
  });
  expect(drawable([said, curve()]).map((one) => one.curve.status)).toEqual([
    "temperature_c",
    "is_open",
  ]);
  expect(readableUnit(said)).toEqual(["% yes", 100]);
  const [at, mean] = bandColumns(said, null, [], 100);
  expect(at).toEqual([0, 1]);
  expect(mean).toEqual([100, 0]);
  const [, share, low, high] = bandColumns(
    { ...said, points: [[0, 0.25, 0, 1, 4]] },
    null,
    [],
    100,
  );
  expect([share, low, high]).toEqual([[25], [0], [100]]);
});

test("yes and no of a status that tells something else draw nothing", () => {
  expect(drawable([curve({ points: [[0, true]] })])).toEqual([]);
});
