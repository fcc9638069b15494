import { expect, test } from "vitest";
import { layoutGantt, scheduleJobs, share, ticks } from "./gantt";
import { aJob, aRun, BEGIN_S, iso } from "./samples";

test("what ran keeps its measured place, what is to come follows what it waits for", () => {
  const run = aRun([
    aJob(0, "a", "complete", { started_at: iso(0), ended_at: iso(12) }),
    aJob(1, "a", "running", { started_at: iso(12), after: [0] }),
    aJob(2, "b", "queued", { after: [1] }),
    aJob(3, "b", "queued", { after: [2] }),
  ]);
  const bars = scheduleJobs(run, BEGIN_S + 15);
  expect(bars.map((bar) => [bar.look, bar.start_s - BEGIN_S, bar.end_s - BEGIN_S])).toEqual([
    ["done", 0, 12],
    ["run", 12, 22],
    ["plan", 22, 32],
    ["plan", 32, 42],
  ]);
});

test("what was planned again before it began is not drawn", () => {
  const run = aRun([
    aJob(0, "a", "stopped", { ended_at: iso(5), passed_by: "change" }),
    aJob(1, "a", "stopped", { ended_at: iso(5) }),
    aJob(2, "a", "running", { started_at: iso(6) }),
  ]);
  expect(scheduleJobs(run, BEGIN_S + 7).map((bar) => bar.job.index)).toEqual([1, 2]);
});

test("a late action stretches to now and pushes what follows", () => {
  const run = aRun([
    aJob(0, "a", "running", { started_at: iso(0) }),
    aJob(1, "a", "queued", { after: [0] }),
  ]);
  const bars = scheduleJobs(run, BEGIN_S + 60);
  expect(bars[0]?.end_s).toBe(BEGIN_S + 60);
  expect(bars[1]?.start_s).toBe(BEGIN_S + 60);
});

test("an action in doubt ends where its doubt began", () => {
  const run = aRun([aJob(0, "a", "in_doubt", { started_at: iso(0), state_at: iso(7) })]);
  const [bar] = scheduleJobs(run, BEGIN_S + 100);
  expect(bar).toMatchObject({ look: "doubt", end_s: BEGIN_S + 7 });
});

test("two actions of one device never share a time that is only planned", () => {
  const run = aRun([aJob(0, "a", "queued"), aJob(2, "b", "queued")]);
  const [first, second] = scheduleJobs(run, BEGIN_S);
  expect(second?.start_s).toBe(first?.end_s);
});

test("rows are devices or steps, and every bar lies inside the window", () => {
  const run = aRun([
    aJob(0, "a", "complete", { started_at: iso(0), ended_at: iso(5) }),
    aJob(1, "b", "queued", { after: [0] }),
  ]);
  const byDevice = layoutGantt(run, BEGIN_S + 10, "devices");
  expect(byDevice.rows.map((row) => row.name)).toEqual(["Pump 1", "Pump 2"]);
  expect(layoutGantt(run, BEGIN_S + 10, "steps").rows.map((row) => row.id)).toEqual(["a", "b"]);
  for (const bar of byDevice.rows.flatMap((row) => row.bars)) {
    expect(bar.start_s).toBeGreaterThan(byDevice.from_s);
    expect(bar.end_s).toBeLessThan(byDevice.to_s);
  }
  expect(byDevice.now_s).toBe(BEGIN_S + 10);
});

test("a run that is over shows no now, and nothing that never began", () => {
  const run = aRun(
    [aJob(0, "a", "complete", { started_at: iso(0), ended_at: iso(5) }), aJob(1, "b", "aborted")],
    { state: "aborted", ended_at: iso(6) },
  );
  const gantt = layoutGantt(run, BEGIN_S + 5000, "devices");
  expect(gantt.now_s).toBeNull();
  expect(gantt.rows.flatMap((row) => row.bars)).toHaveLength(1);
  expect(gantt.to_s).toBeLessThan(BEGIN_S + 10);
});

test("ticks are round and few", () => {
  const window = { from_s: BEGIN_S + 7, to_s: BEGIN_S + 3600 };
  const found = ticks(window);
  expect(found.length).toBeLessThanOrEqual(6);
  expect(found.every((at) => at % 600 === 0)).toBe(true);
  expect(share(window, BEGIN_S - 50)).toBe(0);
});

test("what a host does that works alone is expected, not known", () => {
  const jobs = [aJob(0, "a", "running", { started_at: iso(0) }), aJob(1, "a", "complete")];
  const host = { id: "h", name: "Host 1", since_at: iso(1), jobs_count: 1, job_ids: ["j0", "j1"] };
  const looks = (hosts_away: (typeof host)[]) =>
    scheduleJobs(aRun(jobs, { hosts_away }), BEGIN_S + 5).map((bar) => bar.look);
  expect(looks([])[0]).toBe("run");
  expect(looks([host])[0]).toBe("away");
});
