import { expect, test } from "vitest";
import { outcomeOf, triedText, wireText } from "./tryouts";
import type { TryoutAct } from "./wiretryouts";

const nothing = {
  actions: [],
  left_out: ["wait", "stop"],
  failed: [],
  statuses_were_read: false,
  faults: [],
};

test("what was tried is said in one line, and nothing where nothing was", () => {
  expect(triedText(nothing)).toBeNull();
  expect(
    triedText({
      ...nothing,
      actions: ["heat"],
      statuses_were_read: true,
      faults: ["busy", "stall"],
    }),
  ).toBe("1 of 3 actions, statuses read, 2 faults");
  expect(triedText({ ...nothing, failed: ["wait"] })).toBe("0 of 2 actions, no fault");
});

test("bytes are text where every one is printable, else digits", () => {
  expect(wireText("494e5f50565f30300d0a")).toBe("IN_PV_00\\r\\n");
  expect(wireText("0103")).toBe("01 03");
  expect(wireText("41ff")).toBe("41 ff");
  expect(wireText("")).toBe("");
});

const act: TryoutAct = {
  number: 1,
  sort: "act",
  name: "aspirate",
  args: {},
  asked_at: "2026-11-22T10:00:00Z",
  answered_at: "2026-11-22T10:00:01Z",
  code: "",
  message: "",
  effect: "",
  data: { moved_ul: 5, evidence: { volume_ul: 5 } },
  has_faults: false,
};

test("what came of a wish is its report, its refusal, or that it is under way", () => {
  expect(outcomeOf(act)).toEqual({ look: "ok", text: "moved 5 µL, volume_ul 5" });
  expect(outcomeOf({ ...act, code: "device.timeout", message: "no answer" })).toEqual({
    look: "error",
    text: "no answer",
  });
  expect(outcomeOf({ ...act, answered_at: null }).look).toBe("running");
  expect(outcomeOf({ ...act, sort: "read", data: { problems: { ph: "silent" } } })).toEqual({
    look: "error",
    text: "silent",
  });
});
