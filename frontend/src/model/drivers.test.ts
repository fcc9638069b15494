import { describe, expect, test } from "vitest";
import {
  groupDrivers,
  isChanging,
  isShown,
  linesOf,
  modelOf,
  moduleName,
  orderedModules,
  progressOf,
  sourceFinding,
} from "./drivers";
import { aDriver, aPlace } from "./samples";

describe("names", () => {
  test("a module is named by class and model, or not at all", () => {
    expect(moduleName("sensors", "ph_9")).toBe("drivers.sensors.ph_9");
    expect(moduleName("", "ph_9")).toBeNull();
    expect(moduleName("sensors", "Ph")).toBeNull();
    expect(moduleName("base", "ph")).toBeNull();
  });

  test("a file is no model when Python could not import it by that name", () => {
    expect(modelOf("ika_rct.py")).toBe("ika_rct");
    for (const name of ["IKA.py", "9ika.py", "_shared.py", "ika.txt", "a-b.py"])
      expect(modelOf(name)).toBe("");
  });
});

describe("the list", () => {
  const rows = [
    aDriver({
      id: "1",
      read_at: "2026-11-01T00:00:00Z",
      devices: [{ id: "d", key: "k", name: "Pump 1" }],
    }),
    aDriver({ id: "2", state: "proposed", origin: "upload", proposed_at: "2026-11-02T00:00:00Z" }),
    aDriver({ id: "3", module: "drivers.sensors.other", class_name: "Other" }),
  ];
  const [timer, other] = groupDrivers(rows);

  test("versions of one module are one row, the newest first", () => {
    expect(timer?.versions.map((row) => row.id)).toEqual(["2", "1"]);
    expect(timer?.devices.map((device) => device.name)).toEqual(["Pump 1"]);
    expect(other?.versions).toHaveLength(1);
  });

  test.each([
    ["all", "", [true, true]],
    ["used", "", [true, false]],
    ["waiting", "", [true, false]],
    ["brought", "", [true, false]],
    ["all", "pump 1", [true, false]],
    ["all", "OTHER", [false, true]],
    ["used", "other", [false, false]],
  ] as const)("%s with '%s'", (filter, text, wanted) => {
    expect([timer, other].map((group) => group && isShown(group, filter, text))).toEqual(wanted);
  });
});

test("a finding is told by rule, line and what to write instead", () => {
  const finding = {
    code: "driver.drv011",
    message: "numpy is not among them",
    subject: "drivers/sensors/a.py:2",
    context: { file: "drivers/sensors/a.py", line: 2, suggestion: "import math" },
  };
  expect(sourceFinding(finding)).toEqual({
    rule: "DRV011",
    where: "drivers/sensors/a.py:2",
    message: "numpy is not among them",
    suggestion: "import math",
  });
});

describe("progress", () => {
  const next = { version_id: "2", digest: "b".repeat(64), is_ready: false };

  test("a device without a change has none", () => {
    expect(progressOf(aPlace())).toEqual({ reached: null, text: "", isBad: false });
    expect(isChanging([aPlace()])).toBe(false);
  });

  test("a staged one waits for its host, which may be away", () => {
    const place = aPlace({ driver: { ...aPlace().driver, next } });
    expect(progressOf(place)).toMatchObject({ reached: 1 });
    expect(progressOf(place).text).toContain("builds it once");
    const host = { ...place.host, state: "isolated" as const };
    expect(progressOf({ ...place, host }).text).toContain("is away");
    expect(isChanging([place])).toBe(true);
  });

  test("a ready one waits for the end of the job that acts", () => {
    const driver = { ...aPlace().driver, next: { ...next, is_ready: true } };
    const job = { id: "j", run_id: "r", run_number: 7, sentence: "Heat it" };
    expect(progressOf(aPlace({ driver, job })).text).toContain("run #7");
    expect(progressOf(aPlace({ driver })).reached).toBe(2);
  });

  test("what the host could not build is told", () => {
    const problem = { digest: "b", code: "driver.import", message: "NameError", at: "" };
    const found = progressOf(aPlace({ driver: { ...aPlace().driver, problem } }));
    expect(found).toMatchObject({ reached: null, isBad: true });
    expect(found.text).toContain("NameError");
  });
});

test("lines are counted as an editor counts them", () => {
  expect(linesOf("a\nb\n")).toEqual(["a", "b"]);
  expect(linesOf("a\n\nb")).toEqual(["a", "", "b"]);
});

test("the driver's own module comes first", () => {
  expect(orderedModules("d.b", { "d.a": "", "d.b": "", "d.c": "" })).toEqual(["d.b", "d.a", "d.c"]);
});
