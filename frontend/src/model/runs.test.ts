import { expect, test } from "vitest";
import { conditionText, evidenceRows, problemText, waitingSteps } from "./evidence";
import { currentStep, deviceName, findProblems, pauseText, stepProgress } from "./runs";
import { aJob, aRun, iso } from "./samples";
import type { Correction } from "./wire";

const doubtful = () =>
  aRun([
    aJob(0, "a", "complete", { started_at: iso(0), ended_at: iso(5) }),
    aJob(1, "a", "in_doubt", { after: [0], started_at: iso(5), state_at: iso(20) }),
    aJob(2, "b", "queued", { after: [1] }),
    aJob(3, "c", "running", { started_at: iso(6) }),
  ]);

test("a step in doubt holds up what comes after it and nothing else", () => {
  const steps = stepProgress(doubtful());
  expect(steps.map((step) => step.state)).toEqual(["doubt", "waiting", "running"]);
  expect(steps[1]?.after).toBe(1);
  expect(currentStep(steps)?.number).toBe(3);
});

test("a step is done only when each of its actions is", () => {
  const run = aRun([
    aJob(0, "a", "complete", { started_at: iso(0), ended_at: iso(5) }),
    aJob(1, "a", "queued", { after: [0] }),
  ]);
  expect(stepProgress(run)[0]).toMatchObject({ state: "running", ended_s: null });
});

test("what is in doubt comes before what failed, and a pause last", () => {
  const run = aRun([aJob(0, "a", "rejected"), aJob(1, "b", "in_doubt")], {
    state: "paused",
    pause_reasons: [{ kind: "person", by: "Li Na", at: iso(9) }],
  });
  expect(findProblems(run).map((problem) => problem.kind)).toEqual(["doubt", "failed", "paused"]);
});

test("each pause says who stands behind it, in words", () => {
  const told = (kind: string, by: string | null) => pauseText({ kind, by, at: iso(0) });
  expect(told("user", "Li Na")).toBe("Paused by Li Na");
  expect(told("stopped", "Wang Wei")).toBe("Lab stopped by Wang Wei");
  expect(told("recovery", "Li Na")).toBe("Waits to be resumed after a decision by Li Na");
  expect(told("server error", null)).toBe("The server cannot dispatch it");
});

test("the card says which steps wait for the answer", () => {
  const run = doubtful();
  const [, doubt] = run.jobs;
  expect(doubt && waitingSteps(run, doubt)).toEqual([2]);
});

test("evidence is told in words with units, and keys of the machine are left out", () => {
  const job = aJob(0, "a", "in_doubt", {
    started_at: iso(0),
    message: "no answer within 12 s",
    evidence: {
      report: { sent_at: iso(3), moved_ul: 4860, attempt_id: "x" },
      pre: [{ name: "pump.valve_at_source", verdict: "pass", message: "port is 3" }],
    },
  });
  expect(evidenceRows(job, (at) => `t${at - 1_800_000_000}`)).toEqual([
    { label: "Command", text: "Pump 1: aspirate, volume 5.00\u202fmL; begun t0" },
    { label: "Completion", text: "No answer within 12 s" },
    { label: "Sent", text: "t3" },
    { label: "Moved", text: "4.86\u202fmL" },
    { label: "Before: valve at source", text: "port is 3, pass" },
  ]);
});

test("what the device tells stands with its time, and that it does not answer", () => {
  const readings = [
    { status: "volume_ul", label: "Volume", unit: "µL", value: 2018.333 },
    { status: "is_initialized", label: "", unit: "", value: true },
  ].map((one) => ({ ...one, name: one.status, doc: "", at_s: 1_800_000_007 }));
  const told = (link: "online" | "offline") =>
    evidenceRows(aJob(0, "a", "in_doubt"), (at) => `t${at - 1_800_000_000}`, { link, readings });
  const label = "The device tells";
  expect(told("online")).toContainEqual({ label, text: "volume 2.02\u202fmL at t7" });
  const text = "volume 2.02\u202fmL at t7; it does not answer now";
  expect(told("offline")).toContainEqual({ label, text });
});

test("a condition that failed is told with units, as the reason too", () => {
  const result = {
    name: "pump.syringe_before",
    verdict: "fail",
    message: "volume_ul is 2000.0, wanted 0.0 to 0.0",
    evidence: { value: 2000, status: "volume_ul", wanted: "0.0 to 0.0" },
  };
  const text = "volume 2.00\u202fmL, wanted 0.00\u202fmL";
  expect(conditionText(result)).toBe(text);
  expect(conditionText({ ...result, evidence: {} })).toBe(result.message);
  const job = aJob(0, "a", "rejected", { message: result.message, evidence: { pre: [result] } });
  expect(problemText(job)).toBe(`Syringe before: ${text}`);
  expect(problemText(aJob(0, "a", "aborted", { message: "it is stuck" }))).toBe("It is stuck");
});

test.each([
  [{ value: true, status: "is_initialized", wanted: "True" }, "initialized: yes, wanted yes"],
  [{ value: false, status: "is_initialized", wanted: "True" }, "initialized: no, wanted yes"],
  [{ value: 2, status: "port_index", wanted: "1" }, "port 2, wanted 1"],
  [{ value: "VIAL_8", status: "tag", wanted: "VIAL_7" }, "tag VIAL_8, wanted VIAL_7"],
])("a condition is told in words: %j", (evidence, text) => {
  const pre = [{ name: "pump.is_initialized", verdict: "pass", message: "raw", evidence }];
  const rows = evidenceRows(aJob(0, "a", "in_doubt", { evidence: { pre } }), String);
  expect(rows).toContainEqual({ label: "Before: initialized", text: `${text}, pass` });
  expect(conditionText({ name: "a.b", verdict: "pass", message: "raw", evidence })).toBe(text);
});

test("the line of a device is told by the device and its socket, not by a path", () => {
  const told = (line: string) =>
    evidenceRows(
      aJob(0, "a", "in_doubt", { evidence: { report: { evidence: { line, received: "" } } } }),
      String,
    ).filter((row) => /line/i.test(row.label + row.text));
  expect(told("serial:/tmp/lab/run/line1.tty")).toEqual([
    { label: "Line", text: "Pump 1, serial line line1.tty" },
  ]);
  expect(told("tcp:127.0.0.1:40469")).toEqual([
    { label: "Line", text: "Pump 1, network line 127.0.0.1:40469" },
  ]);
  const message = "serial:/dev/ttyUSB0 cannot be opened: no such file";
  expect(problemText(aJob(0, "a", "aborted", { message }))).toBe(
    "Serial line ttyUSB0 cannot be opened: no such file",
  );
});

const aCorrection = (fields: Partial<Correction>): Correction => ({
  argument: "",
  quantity: "volume",
  asked: null,
  sent: null,
  gain: 1,
  offset: 0,
  calibration_id: "c",
  number: 1,
  low: null,
  high: null,
  needs: null,
  expires_at: null,
  ...fields,
});

test("a number that a calibration made right stands as asked and as sent", () => {
  const job = aJob(0, "a", "complete", {
    corrections: [aCorrection({ argument: "volume_ul", asked: 2000, sent: 2061.8557, number: 3 })],
  });
  expect(evidenceRows(job, String)[1]).toEqual({
    label: "Volume",
    text: "2000\u202fµL asked for, 2061.86\u202fµL sent, by calibration 3",
  });
});

test("a reading stands as told and as true, and beyond its levels nothing is claimed", () => {
  const corrections = [aCorrection({ argument: "value_ph", quantity: "ph", number: 2 })];
  const told = (value: number | null) =>
    evidenceRows(
      aJob(0, "a", "complete", {
        corrections,
        evidence: { corrected: { value_ph: { raw: 7.1, value, number: 2 } } },
      }),
      String,
    ).find((row) => row.text.includes("told"))?.text;
  expect(told(7.05)).toBe("7.1\u202fpH told, 7.05\u202fpH true, by calibration 2");
  expect(told(null)).toContain("not known beyond what was calibrated");
  expect(evidenceRows(aJob(0, "a", "queued", { corrections }), String)).toHaveLength(2);
});

test("a job that asks for a role has no device before its turn", () => {
  const choices = { choices_count: 2 };
  expect(deviceName(aJob(0, "a", "queued", choices))).toBe("one of 2 devices");
  const sent = aJob(0, "a", "in_doubt", choices);
  expect(deviceName(sent)).toBe(sent.device.name);
  const fixed = aJob(0, "a", "queued");
  expect(deviceName(fixed)).toBe(fixed.device.name);
});

test("a step of an aborted run that was done is done, though the abort switched it off", () => {
  const jobs = [aJob(0, "a", "complete", { halted_by: "run.aborted" }), aJob(1, "b", "aborted")];
  const states = (is_given_up: boolean): string[] =>
    stepProgress(aRun(jobs, { is_given_up })).map((step) => step.state);
  expect(states(true).slice(0, 2)).toEqual(["done", "failed"]);
  expect(states(false).slice(0, 2)).toEqual(["failed", "failed"]);
});
