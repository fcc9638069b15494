import { expect, test } from "vitest";
import { makePalette } from "./document";
import {
  changeWords,
  formatAge,
  formatDuration,
  formatLeft,
  formatFact,
  formatNumber,
  formatVolume,
  LabTime,
  readingText,
  sentence,
} from "./format";
import { layoutBoxes } from "./layout";
import { aDocument, aRow, OPERATIONS } from "./samples";
import { namesOf, sentenceOf, sentenceText } from "./sentence";
import { appendSamples, pairSeries, plotColumns, readable } from "./telemetry";
import { findChoices, visibleRows } from "./tree";

test("amounts are shown in the unit a chemist would write", () => {
  expect(formatVolume(5_000_000)).toBe("5.00\u202fmL");
  expect(formatVolume(50_000)).toBe("50.0\u202fµL");
  expect(formatVolume(310_000_000)).toBe("310.0\u202fmL");
  expect(formatNumber(-1234567.5)).toBe("\u22121\u202f234\u202f567.5");
  expect(formatNumber(Number.NaN)).toBe("–");
});

test("a field of a resource is read with the unit that its name says", () => {
  expect(formatFact("capacity_ul", 100_000)).toEqual(["Capacity", "100.0\u202fmL"]);
  expect(formatFact("temperature_c", 22)).toEqual(["Temperature", "22.0\u202f°C"]);
  expect(formatFact("tare_mg", 62_000)).toEqual(["Tare", "62.000\u202fg"]);
  expect(formatFact("ports_count", 8)).toEqual(["Ports count", "8"]);
});

test("a message begins with a capital, a name and a unit keep theirs", () => {
  expect(sentence("no whole answer in time")).toBe("No whole answer in time");
  expect(sentence("the syringe's plunger")).toBe("The syringe's plunger");
  expect(sentence("pH 1 is not enrolled")).toBe("pH 1 is not enrolled");
  expect(sentence("volume_ul is missing")).toBe("volume_ul is missing");
  expect(sentence("")).toBe("");
});

test("durations and ages are short", () => {
  expect([5, 760, 3750].map(formatDuration)).toEqual(["0:05", "12:40", "1:02:30"]);
  expect([3750, 31_535_959].map(formatLeft)).toEqual(["1:02:30", "364 days"]);
  expect([0.5, 42, 600].map(formatAge)).toEqual(["0.5\u202fs", "42\u202fs", "10\u202fmin"]);
});

test("a time read off the lab's clock is found again, also when clocks change", () => {
  for (const zone of ["UTC", "Asia/Shanghai", "Europe/Zurich", "America/New_York"]) {
    const time = new LabTime(zone);
    for (const at of ["2026-03-29T12:00:05Z", "2026-03-29T00:30:00Z", "2026-10-25T12:00:00Z"])
      expect(time.instant(time.field(at))).toBe(new Date(at).toISOString());
  }
  expect(new LabTime("Asia/Shanghai").instant("2026-11-20T14:02:07")).toBe(
    "2026-11-20T06:02:07.000Z",
  );
  expect(new LabTime("UTC").instant("")).toBeNull();
});

test("times are those of the lab, in 24 hours", () => {
  const shanghai = new LabTime("Asia/Shanghai");
  expect(shanghai.second("2026-11-20T06:02:07Z")).toBe("14:02:07");
  expect(shanghai.long("2026-11-20T16:30:00Z")).toBe("Sat 2026-11-21 00:30");
  expect(shanghai.second("nonsense")).toBe("–");
});

test("a sentence leaves out a clause whose field is empty, and marks what is missing", () => {
  const palette = makePalette(OPERATIONS);
  const names = namesOf([
    aRow("r1", null, { name: "Water" }),
    aRow("r2", null, { name: "Reactor 1" }),
  ]);
  const texts = aDocument().steps.map((step) =>
    sentenceText(sentenceOf(palette.get(step.kind), step, names)),
  );
  expect(texts[0]).toBe("Transfer 5\u202fmL from Water to Reactor 1");
  expect(texts[1]).toBe("Transfer 1\u202fmL from Reactor 1 to …");
});

test("a closed branch hides all below it, and a search shows the way to each hit", () => {
  const rows = [
    aRow("lab", null),
    aRow("bench", "lab"),
    aRow("deck", "bench"),
    aRow("vial", "deck"),
  ];
  expect(visibleRows(rows, new Set(["bench"]), "").map((r) => r.id)).toEqual(["lab", "bench"]);
  expect(visibleRows(rows, new Set(["bench"]), "vial")).toHaveLength(4);
});

test("only what fits may stand in a field", () => {
  const rows = [
    aRow("flask", null),
    aRow("pump", null, { kind: "syringe_pump", device: { id: "d", name: "P" } }),
    aRow("old", null, { is_archived: true }),
    aRow("balance", null, { kind: "balance", holds_liquid: false }),
  ];
  expect(findChoices(rows, { holds: "liquid" }).map((r) => r.id)).toEqual(["flask"]);
  expect(findChoices(rows, { kind: ["balance"] }).map((r) => r.id)).toEqual(["balance"]);
  expect(findChoices(rows, { acts: true }).map((r) => r.id)).toEqual(["pump"]);
});

test("readings are paired with their setpoint, and text is no curve", () => {
  const channels = pairSeries(
    { temperature_c: [[1, 20]], temperature_setpoint_c: [[1, 60]], state: [[1, "busy"]] },
    [{ name: "temperature_c", label: "Temperature", unit: "°C" }],
  );
  expect(channels).toEqual([
    {
      status: "temperature_c",
      label: "Temperature",
      unit: "°C",
      points: [[1, 20]],
      setpoints: [[1, 60]],
    },
  ]);
});

test("a silent time is a gap in the curve and not a line across it", () => {
  const points: [number, number][] = [
    [0, 1],
    [1, 1],
    [2, 1],
    [60, 5],
  ];
  const [xs, ys] = plotColumns({ status: "s", label: "", unit: "", points, setpoints: [] });
  expect(xs).toEqual([0, 1, 2, 31, 60]);
  expect(ys).toEqual([1, 1, 1, null, 5]);
});

test("live samples are added once, and what is too old is let go", () => {
  const series = appendSamples(
    {
      s: [
        [0, 1],
        [90, 2],
      ],
    },
    [
      ["s", 90, 2],
      ["s", 100, 3],
    ],
    50,
  );
  expect(series.s).toEqual([
    [90, 2],
    [100, 3],
  ]);
});

test("the automatic layout puts what comes later to the right", () => {
  const boxes = ["a", "b"].map((id) => ({ id, width: 100, height: 40 }));
  const places = layoutBoxes(boxes, [{ source: "a", target: "b" }], { rank: 50, node: 10 });
  expect(places.get("b")?.x).toBe((places.get("a")?.x ?? 0) + 150);
});

test.each(["constructor", "__proto__", "toString", "_root"])("a step may have the id %s", (id) => {
  const boxes = [id, "b", "c"].map((one) => ({ id: one, width: 100, height: 40 }));
  const links = [
    { source: id, target: "b" },
    { source: "b", target: "c" },
    { source: "c", target: id },
    { source: id, target: id },
  ];
  const places = layoutBoxes(boxes, links, { rank: 50, node: 10 });
  expect([...places.keys()]).toEqual([id, "b", "c"]);
});

test("on a narrow screen it puts what comes later below", () => {
  const boxes = ["a", "b"].map((id) => ({ id, width: 100, height: 40 }));
  const links = [{ source: "a", target: "b" }];
  const places = layoutBoxes(boxes, links, { rank: 50, node: 10 }, "TB");
  expect(places.get("b")).toEqual({ x: places.get("a")?.x, y: (places.get("a")?.y ?? 0) + 90 });
});

test.each([
  [31000, "mg", "31.000 g"],
  [420, "mg", "420 mg"],
  [3053.333, "µL", "3.05 mL"],
  [22, "°C", "22.0 °C"],
  ["ready", "", "ready"],
])("a reading of %s %s is written %s", (value, unit, text) => {
  expect(readingText(value, unit).replaceAll("\u202f", " ")).toBe(text);
});

test.each([
  ["port_index 3", "port 3"],
  ["is_initialized True", "initialized"],
  ["is_running False", "not running"],
  ["temperature_setpoint_c 40.0", "set 40.0 °C"],
  ["mass_mg 31000.0", "31.000 g"],
  ["state ready", "state ready"],
  ["temperature_setpoint_c None", "no temperature set"],
  ["rate_setpoint_ul_s unknown", "unknown rate"],
  ["port_index unknown, is_initialized unknown", "unknown port, unknown whether initialized"],
])("the change %s is written %s", (text, words) => {
  expect(changeWords(text).replaceAll("\u202f", " ")).toBe(words);
});

test("a curve is drawn in the unit in which its value is written", () => {
  const channel = {
    status: "volume_ul",
    label: "Volume",
    unit: "µL",
    points: [[1, 4000]] as [number, number][],
    setpoints: [],
  };
  expect(readable(channel)).toMatchObject({ unit: "mL", points: [[1, 4]] });
  expect(readable({ ...channel, points: [[1, 250]] }).unit).toBe("µL");
});
