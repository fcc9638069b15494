/** Rules of the drivers' pages: names, groups, and how far a replacement has come. */

import type { State } from "./states";
import type { DriverPlace, DriverRow, DriverStateName } from "./wiredrivers";
import type { Finding } from "./wire";

/** Folders of the package that hold drivers. */
export const CLASSES = [
  "sensors",
  "connectors",
  "processing",
  "characterization",
  "logistics",
  "virtual",
] as const;

const STATE: Record<DriverStateName, State> = {
  proposed: { look: "needs", word: "Waits for approval" },
  approved: { look: "idle", word: "Approved" },
  rejected: { look: "error", word: "Rejected" },
  withdrawn: { look: "offline", word: "Withdrawn" },
};

export const driverState = (state: DriverStateName): State => STATE[state];

/** All versions of one driver, the newest first. */
export interface DriverGroup {
  module: string;
  newest: DriverRow;
  versions: DriverRow[];
  devices: DriverRow["devices"];
}

export function groupDrivers(rows: DriverRow[]): DriverGroup[] {
  const groups = new Map<string, DriverRow[]>();
  for (const row of rows) groups.set(row.module, [...(groups.get(row.module) ?? []), row]);
  return [...groups].map(([module, versions]) => {
    const sorted = newestFirst(versions);
    return {
      module,
      newest: sorted[0] as DriverRow,
      versions: sorted,
      devices: sorted.flatMap((row) => row.devices),
    };
  });
}

const when = (row: DriverRow): string => row.proposed_at ?? row.read_at;

export function newestFirst(rows: DriverRow[]): DriverRow[] {
  return [...rows].sort((a, b) => when(b).localeCompare(when(a)));
}

export type Filter = "all" | "used" | "waiting" | "brought";

export function isShown(group: DriverGroup, filter: Filter, text: string): boolean {
  const words = text.trim().toLowerCase();
  const names = [group.module, ...group.versions.map((row) => `${row.class_name} ${row.digest}`)];
  const devices = group.devices.map((device) => device.name);
  if (words && ![...names, ...devices].some((name) => name.toLowerCase().includes(words)))
    return false;
  if (filter === "used") return group.devices.length > 0;
  if (filter === "waiting") return group.versions.some((row) => row.state === "proposed");
  return filter === "all" || group.versions.some((row) => row.origin === "upload");
}

/** Model of a file's name, "" when the name cannot be that of a module. */
export function modelOf(fileName: string): string {
  return /^([a-z][a-z0-9_]{0,60})\.py$/.exec(fileName)?.[1] ?? "";
}

export function moduleName(folder: string, model: string): string | null {
  const isClass = (CLASSES as readonly string[]).includes(folder);
  return isClass && /^[a-z][a-z0-9_]{0,60}$/.test(model) ? `drivers.${folder}.${model}` : null;
}

/** Class folder and model of `drivers.<class>.<model>`. */
export function partsOf(module: string): [folder: string, model: string] {
  const [, folder = "", model = ""] = module.split(".");
  return [folder, model];
}

export interface SourceFinding {
  rule: string;
  where: string;
  message: string;
  suggestion: string;
}

export function sourceFinding(finding: Finding): SourceFinding {
  const { line, suggestion } = finding.context;
  const file = finding.subject.replace(/:\d+$/, "");
  return {
    rule: finding.code.replace(/^driver\./, "").toUpperCase(),
    where: typeof line === "number" ? `${file}:${line}` : finding.subject,
    message: finding.message,
    suggestion: typeof suggestion === "string" ? suggestion : "",
  };
}

export const STAGES = ["staged", "ready", "switched"] as const;

export interface Progress {
  /** How many of the stages are behind it; null when nothing is under way. */
  reached: number | null;
  text: string;
  isBad: boolean;
}

const AWAY = new Set(["offline", "isolated", "quarantined"]);

/** How far a device has come towards its next version, and what it waits for. */
export function progressOf(place: DriverPlace): Progress {
  const { next, problem } = place.driver;
  if (!next) {
    if (!problem) return { reached: null, text: "", isBad: false };
    return { reached: null, text: `The version before stays: ${problem.message}`, isBad: true };
  }
  if (!next.is_ready) {
    const text = AWAY.has(place.host.state)
      ? `${place.host.name} is away; it fetches the version when it is back.`
      : `${place.host.name} fetches the version and builds it once.`;
    return { reached: 1, text, isBad: false };
  }
  const text = place.job
    ? `Changes when run #${place.job.run_number} has ended ${place.job.sentence}.`
    : "Changes now: nothing acts.";
  return { reached: 2, text, isBad: false };
}

export const isChanging = (places: DriverPlace[]): boolean =>
  places.some((place) => place.driver.next !== null);

/** Lines of a text as an editor counts them. */
export function linesOf(text: string): string[] {
  const lines = text.split("\n");
  if (lines.at(-1) === "") lines.pop();
  return lines;
}

/** Module of the driver first, what it shares after it. */
export function orderedModules(module: string, sources: Record<string, string>): string[] {
  const others = Object.keys(sources).filter((name) => name !== module);
  return [module, ...others.sort()].filter((name) => name in sources);
}
