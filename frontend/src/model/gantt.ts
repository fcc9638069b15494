/** Places of bars on the timeline: when each job ran, runs or is expected to. */

import { toSeconds } from "./format";
import { isActiveJob, isFinalJob } from "./states";
import type { Job, Run } from "./wire";

export type BarLook = "done" | "run" | "away" | "plan" | "doubt" | "bad";

export interface Bar {
  job: Job;
  label: string;
  look: BarLook;
  start_s: number;
  end_s: number;
}

export interface GanttRow {
  id: string;
  name: string;
  bars: Bar[];
}

export interface Gantt {
  rows: GanttRow[];
  from_s: number;
  to_s: number;
  now_s: number | null;
}

const SHORTEST_S = 0.5;
const ROUND_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 43_200];

/** When each job starts and ends: as measured, else as the plan lets expect from now on. */
export function scheduleJobs(
  run: Pick<Run, "jobs" | "started_at" | "state" | "plan" | "hosts_away">,
  now: number,
): Bar[] {
  const ordered = [...run.jobs].sort((a, b) => a.index - b.index);
  const ends = new Map<number, number>();
  const free = new Map<string, number>();
  const isOver = run.state === "complete" || run.state === "aborted";
  const bars: Bar[] = [];
  const away = new Set(run.hosts_away.flatMap((host) => host.job_ids));
  const places = new Map(run.plan.steps.map((step, place) => [step.step_id, `${place + 1}`]));
  const bar = (job: Job, start: number, end: number): Bar => ({
    job,
    label: places.get(job.step_id) ?? "",
    look: away.has(job.id) && isActiveJob(job.state) ? "away" : lookOf(job),
    start_s: start,
    end_s: Math.max(end, start),
  });
  for (const job of ordered) {
    const started = toSeconds(job.started_at);
    const ended = toSeconds(job.ended_at);
    if (started === null && (isOver || isFinalJob(job.state))) {
      ends.set(job.index, ended ?? now);
      // What never began, and others took the place of, has no part in it.
      if (ended !== null && job.passed_by !== "change") bars.push(bar(job, ended, ended));
      continue;
    }
    const waits = job.after.map((index) => ends.get(index) ?? now);
    const start = started ?? Math.max(now, free.get(job.device.id) ?? now, ...waits);
    const end = ended ?? expectedEnd(job, start, started !== null, now);
    ends.set(job.index, end);
    free.set(job.device.id, end);
    bars.push(bar(job, start, end));
  }
  return bars;
}

function expectedEnd(job: Job, start: number, hasStarted: boolean, now: number): number {
  const end = start + Math.max(job.estimate_s, SHORTEST_S);
  if (job.state === "in_doubt") return toSeconds(job.state_at) ?? now;
  return hasStarted ? Math.max(end, now) : end;
}

function lookOf(job: Job): BarLook {
  if (job.state === "in_doubt") return "doubt";
  if (job.state === "complete") return "done";
  if (isFinalJob(job.state)) return "bad";
  return isActiveJob(job.state) ? "run" : "plan";
}

/** Lay a run out by device or by step. */
export function layoutGantt(run: Run, now: number, by: "devices" | "steps"): Gantt {
  const bars = scheduleJobs(run, now);
  const rows = new Map<string, GanttRow>();
  const rowOf = (job: Job): [id: string, name: string] => {
    if (by === "devices") return [job.device.id, job.device.name];
    const place = run.plan.steps.findIndex((step) => step.step_id === job.step_id);
    return [job.step_id, `${place + 1} ${run.plan.steps[place]?.sentence ?? job.step_id}`];
  };
  for (const item of bars) {
    const [id, name] = rowOf(item.job);
    const row = rows.get(id) ?? { id, name, bars: [] };
    row.bars.push(item);
    rows.set(id, row);
  }
  const isOver = run.state === "complete" || run.state === "aborted";
  const begin = toSeconds(run.started_at) ?? now;
  const from = Math.min(begin, ...bars.map((item) => item.start_s));
  const last = Math.max(from + 5, ...bars.map((item) => item.end_s), isOver ? from : now);
  const margin = (last - from) * 0.03;
  return {
    rows: [...rows.values()],
    from_s: from - margin,
    to_s: last + margin,
    now_s: isOver ? null : now,
  };
}

/** Share of the way from start to end of the window, 0 to 1. */
export function share(gantt: Pick<Gantt, "from_s" | "to_s">, at: number): number {
  return Math.min(1, Math.max(0, (at - gantt.from_s) / (gantt.to_s - gantt.from_s)));
}

/** Round times inside the window, about `wanted` of them. */
export function ticks(gantt: Pick<Gantt, "from_s" | "to_s">, wanted = 6): number[] {
  const span = gantt.to_s - gantt.from_s;
  const step = ROUND_S.find((size) => span / size <= wanted) ?? 86_400;
  const found: number[] = [];
  for (let at = Math.ceil(gantt.from_s / step) * step; at <= gantt.to_s; at += step) found.push(at);
  return found;
}
