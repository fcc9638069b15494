import { expect, test } from "vitest";
import {
  axisLabel,
  drawnColumns,
  firstDrawn,
  formatBytes,
  LARGEST_BYTES,
  markTexts,
  usualFormat,
  whyNotSent,
} from "./files";
import type { Drawn, FileReading } from "./wirefiles";

const axis = { column: "time", unit: "s", points_count: 3, least: 0, most: 2 };

function aReading(id: string, points: number | null): FileReading {
  return {
    id,
    file_id: "f",
    file_sha256: "ab".repeat(32),
    facts: {},
    kept_at: "2026-11-20T06:02:07Z",
    resource_id: null,
    device_id: null,
    job_id: null,
    index: 1,
    name: id,
    quantity: id,
    unit: "1",
    value: points === null ? 1 : null,
    text: "",
    series_file_id: points === null ? null : "s",
    series: points === null ? null : { ...axis, points_count: points, axes: [axis] },
    measured_at: null,
  };
}

test("the usual format of a name is told, and of an unknown one that nothing is read", () => {
  expect(usualFormat("A.B.JDX")).toBe("jcamp");
  expect(usualFormat("cycle.ndax")).toBe("neware");
  expect(usualFormat("photo.png")).toBe("none");
  expect(usualFormat("")).toBe("none");
});

test("sizes are told in the unit a person reads", () => {
  expect(formatBytes(999)).toBe("999 B");
  expect(formatBytes(1500)).toBe("1.5 kB");
  expect(formatBytes(999_960)).toBe("1.0 MB");
});

test("nothing is sent without a file, without a subject, or beyond the bound", () => {
  expect(whyNotSent(null, true)).toMatch(/Choose/);
  expect(whyNotSent({ name: "a", size: 0 }, true)).toMatch(/empty/);
  expect(whyNotSent({ name: "a", size: LARGEST_BYTES + 1 }, true)).toMatch(/may have/);
  expect(whyNotSent({ name: "a", size: 1 }, false)).toMatch(/Say what/);
  expect(whyNotSent({ name: "a", size: 1 }, true)).toBeNull();
});

test("the longest series is drawn first, and none where there is none", () => {
  const readings = [aReading("value", null), aReading("short", 3), aReading("long", 9)];
  expect(firstDrawn(readings)?.id).toBe("long");
  expect(firstDrawn([aReading("value", null)])).toBeNull();
});

test("a spectrum from high to low is drawn from low to high, and a gap stays a gap", () => {
  const drawn: Drawn = {
    reading_id: "r",
    x: axis,
    y: axis,
    scan: null,
    points: [
      [4000, 1],
      [2000, null],
      [400, 3],
    ],
    rows_count: 3,
    is_thinned: false,
    is_time: false,
  };
  expect(drawnColumns(drawn)).toEqual([
    [400, 2000, 4000],
    [3, null, 1],
  ]);
});

test("an axis says its unit, and marks have the decimals they need", () => {
  expect(axisLabel({ column: "wavelength", unit: "nm" })).toBe("wavelength (nm)");
  expect(axisLabel({ column: "absorbance", unit: "1" })).toBe("absorbance");
  expect(markTexts([0, 0.05, 0.1])).toEqual(["0.00", "0.05", "0.10"]);
  expect(markTexts([0, 2e6])).toEqual(["0", "2.0e6"]);
});
