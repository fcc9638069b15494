/** What is known of a job whose outcome is not, in rows a person can read. */

import { resolutionText } from "./doubt";
import { THIN, formatArguments, lineWords, plain, sentence, toSeconds } from "./format";
import { isSetpoint } from "./telemetry";
import type { ConditionResult, DeviceRow, Job, Run } from "./wire";

export interface EvidenceRow {
  label: string;
  text: string;
}

/** Suffix that says the unit of a number. */
const UNIT = /_(index|ul_s|mm_s|ul|nl|c|rpm|s|mg|kpa|mm)$/;
const HIDDEN = new Set([
  "ok",
  "message",
  "code",
  "job_id",
  "attempt_id",
  "action_id",
  "findings",
  "effect",
]);

/** Rows from a job's command, report, conditions and answer. */
export function evidenceRows(
  job: Job,
  clock: (at: number) => string,
  device: Pick<DeviceRow, "link" | "readings"> | null = null,
): EvidenceRow[] {
  const rows: EvidenceRow[] = [];
  const sent = toSeconds(job.started_at);
  const args = formatArguments(job.args);
  rows.push({
    label: "Command",
    text: `${job.device.name}: ${job.action.replaceAll("_", " ")}${args ? `, ${args}` : ""}${
      sent === null ? "" : `; begun ${clock(sent)}`
    }`,
  });
  rows.push(...correctionRows(job));
  const ended = toSeconds(job.ended_at);
  rows.push({
    label: "Completion",
    text: problemText(job) || (ended === null ? "not seen" : `reported ${clock(ended)}`),
  });
  rows.push(...toldRows(device, clock));
  rows.push(...reportRows(job.evidence.report ?? {}, clock, job.device.name));
  for (const [word, results] of [
    ["Before", job.evidence.pre],
    ["After", job.evidence.post],
  ] as const) {
    if (!Array.isArray(results)) continue;
    for (const result of results) {
      rows.push({
        label: `${word}: ${nameOf(result)}`,
        text: [conditionText(result), result.verdict].filter(Boolean).join(", "),
      });
    }
  }
  const answer = job.evidence.resolution;
  if (answer) rows.push({ label: "Resolved", text: resolutionText(answer, clock) });
  const failed = job.evidence.then_failed;
  if (failed)
    rows.push({ label: `Not done: ${plain(failed.choice)}`, text: sentence(failed.why_not) });
  return unique(rows);
}

const nameOf = (result: ConditionResult): string =>
  (result.name.split(".").at(-1) ?? result.name).replace(/^is_/, "").replaceAll("_", " ");

const RANGE = /^(\S+) to (\S+)$/;

/** What was seen and wanted, as a person says it, where the host told both. */
export function conditionText({ message, evidence }: ConditionResult): string {
  const { status, value, wanted } = evidence ?? {};
  if (typeof status !== "string" || typeof wanted !== "string") return message;
  if (typeof value === "boolean" && /^(True|False)$/.test(wanted))
    return `${formatArguments({ [status]: value })}, wanted ${plain(wanted === "True")}`;
  if (typeof value === "string") return `${formatArguments({ [status]: value })}, wanted ${wanted}`;
  if (typeof value !== "number") return message;
  const range = RANGE.exec(wanted);
  const ends = (range ? [range[1], range[2]] : [wanted]).map(Number);
  if (!ends.every(Number.isFinite)) return message;
  const told = [...new Set(ends.map((end) => value_(status, end)))].join(" to ");
  return `${formatArguments({ [status]: value })}, wanted ${told}`;
}

/** What kept an action from its end, as a person says it; empty: nothing did, or nobody knows. */
export function problemText(job: Pick<Job, "message" | "evidence">): string {
  const results = [...(job.evidence.pre ?? []), ...(job.evidence.post ?? [])];
  const broken = results.find((result) => result.message === job.message);
  if (!job.message || !broken) return sentence(job.message);
  return sentence(`${nameOf(broken)}: ${conditionText(broken)}`);
}

/** What the device tells, whenever that was: a plunger may still move while one answers. */
function toldRows(
  device: Pick<DeviceRow, "link" | "readings"> | null,
  clock: (at: number) => string,
): EvidenceRow[] {
  if (!device) return [];
  const told = device.readings.flatMap(({ status, value, at_s }) =>
    typeof value === "number" && at_s !== null && !isSetpoint(status)
      ? [`${formatArguments({ [status]: value })} at ${clock(at_s)}`]
      : [],
  );
  if (device.link !== "online") told.push("it does not answer now");
  return told.length ? [{ label: "The device tells", text: told.join("; ") }] : [];
}

const SYMBOLS = { volume: "µL", ph: "pH", temperature: "°C" } as const;
const DIGITS = 6;

/** What a calibration changed: as asked and as sent; of what was read, as told and as it is true. */
function correctionRows(job: Job): EvidenceRow[] {
  const rows: EvidenceRow[] = [];
  for (const one of job.corrections) {
    const exact = (value: number) =>
      `${Number(value.toPrecision(DIGITS))}${THIN}${SYMBOLS[one.quantity]}`;
    const by = `by calibration ${one.number}`;
    if (one.asked !== null && one.sent !== null) {
      const text = `${exact(one.asked)} asked for, ${exact(one.sent)} sent, ${by}`;
      rows.push({ label: label(one.argument), text });
    }
    const read = job.evidence.corrected?.[one.argument];
    if (!read) continue;
    const value =
      read.value === null ? "not known beyond what was calibrated" : `${exact(read.value)} true`;
    rows.push({ label: label(one.argument), text: `${exact(read.raw)} told, ${value}, ${by}` });
  }
  return rows;
}

function reportRows(
  report: Record<string, unknown>,
  clock: (at: number) => string,
  device: string,
): EvidenceRow[] {
  return Object.entries(report).flatMap(([key, value]) => {
    if (HIDDEN.has(key) || value === null || value === "") return [];
    const at = key.endsWith("_at") && typeof value === "string" ? toSeconds(value) : null;
    if (at !== null) return [{ label: label(key.slice(0, -3)), text: clock(at) }];
    if (typeof value === "object") {
      const { line, ...others } = value as Record<string, unknown>;
      const inner = flat(Array.isArray(value) ? value : others);
      const rows = inner ? [{ label: label(key), text: inner }] : [];
      return typeof line === "string" ? [...rows, lineRow(line, device)] : rows;
    }
    return [{ label: label(key), text: value_(key, value) }];
  });
}

const lineRow = (line: string, device: string): EvidenceRow => ({
  label: "Line",
  text: `${device}, ${lineWords(line)}`,
});

function value_(key: string, value: unknown): string {
  if (typeof value !== "number") return plain(value);
  const whole = formatArguments({ [key]: value });
  const words = key.replace(UNIT, "").replaceAll("_", " ");
  return whole.startsWith(`${words} `) ? whole.slice(words.length + 1) : plain(value);
}

const isId = (value: unknown): boolean =>
  typeof value === "string" && /^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$/.test(value);

function flat(value: Record<string, unknown> | unknown[]): string {
  if (Array.isArray(value)) return value.map(plain).join(", ");
  return Object.entries(value)
    .filter(([key, inner]) => !HIDDEN.has(key) && inner !== null && inner !== "" && !isId(inner))
    .map(([key, inner]) => formatArguments({ [key]: inner }))
    .join(", ");
}

function label(key: string): string {
  const words = key.replace(UNIT, "").replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

function unique(rows: EvidenceRow[]): EvidenceRow[] {
  const seen = new Map<string, number>();
  return rows.map((row) => {
    const count = (seen.get(row.label) ?? 0) + 1;
    seen.set(row.label, count);
    return count === 1 ? row : { ...row, label: `${row.label} ${count}` };
  });
}

/** Numbers of the steps that cannot start before this job is settled. */
export function waitingSteps(run: Pick<Run, "plan" | "jobs">, job: Job): number[] {
  const behind = new Set<number>([job.index]);
  const ordered = [...run.jobs].sort((a, b) => a.index - b.index);
  for (const other of ordered) {
    if (other.after.some((index) => behind.has(index))) behind.add(other.index);
  }
  const ids = new Set(
    ordered.filter((other) => behind.has(other.index)).map((other) => other.step_id),
  );
  return run.plan.steps.flatMap((step, place) =>
    ids.has(step.step_id) && step.step_id !== job.step_id ? [place + 1] : [],
  );
}
