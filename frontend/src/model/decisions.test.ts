import { expect, test } from "vitest";
import { decisions, runOutcome } from "./decisions";
import { stepProgress } from "./runs";
import { aJob, aRun, iso } from "./samples";

const skip = {
  choice: "skip" as const,
  job_id: "j1",
  by: "Li Na",
  at: iso(30),
  note: "not needed",
};

test("a step that was skipped is not shown as done", () => {
  const run = aRun([
    aJob(0, "a", "complete"),
    aJob(1, "a", "rejected", { passed_by: "skip" }),
    aJob(2, "a", "stopped", { passed_by: "skip" }),
    aJob(3, "b", "aborted", { passed_by: "hand" }),
    aJob(4, "c", "complete"),
  ]);
  expect(stepProgress(run).map((step) => step.state)).toEqual(["skipped", "by hand", "done"]);
});

test("a run that needed recoveries says how many", () => {
  expect(runOutcome({ state: "complete", recoveries: [] }).word).toBe("Complete");
  expect(runOutcome({ state: "complete", recoveries: [skip] }).word).toBe("Complete, 1 recovery");
  const two = runOutcome({ state: "complete", recoveries: [skip, skip] });
  expect(two.word).toBe("Complete, 2 recoveries");
  expect(runOutcome({ state: "paused", recoveries: [skip] }).word).toBe("Paused");
});

test("choices and answers are listed with who, when and why, the newest first", () => {
  const resolution = { answer: "partly", moved_nl: 2_000_000, by: "Wang Wei", note: "read it" };
  const run = aRun(
    [
      aJob(0, "a", "aborted", { ended_at: iso(20), evidence: { resolution } }),
      aJob(1, "a", "rejected", { passed_by: "skip" }),
    ],
    { recoveries: [{ ...skip, with: [2, 3] }] },
  );
  expect(decisions(run).map(({ what, by, note }) => [what, by, note])).toEqual([
    ["Skipped, with 2 more of its step", "Li Na", "not needed"],
    ["It happened partly, 2.00\u202fmL", "Wang Wei", "read it"],
  ]);
});
