/** Findings: which ring they belong to, in which order they are read, whom they concern. */

import type { Finding } from "./wire";

export const RINGS = ["fields", "graph", "materials", "resources"] as const;
export type Ring = (typeof RINGS)[number];

const GRAPH_CODES = new Set([
  "cycle",
  "unordered",
  "empty",
  "port_types",
  "unknown_port",
  "dangling_edge",
  "material_mismatch",
  "material_twice",
  "duplicate_id",
  "too_many_steps",
]);
const MATERIAL_CODES = new Set(["plan.unknown_density", "plan.syringe_not_empty"]);

/** Which of the five rings found it. */
export function ringOf(finding: Finding): Ring {
  const [area = "", reason = ""] = finding.code.split(".");
  if (area === "unit") return "fields";
  if (area === "protocol") {
    return GRAPH_CODES.has(reason) || finding.context.field === "edges" ? "graph" : "fields";
  }
  if (area === "crutd" || area === "contents" || MATERIAL_CODES.has(finding.code))
    return "materials";
  return "resources";
}

/** Innermost ring first, then in the order of the steps, then by code. */
export function sortFindings(findings: readonly Finding[], order: readonly string[]): Finding[] {
  const rank = new Map(order.map((id, place) => [id, place]));
  const place = (finding: Finding): number => rank.get(finding.subject) ?? order.length;
  return [...findings].sort(
    (a, b) =>
      RINGS.indexOf(ringOf(a)) - RINGS.indexOf(ringOf(b)) ||
      place(a) - place(b) ||
      a.code.localeCompare(b.code) ||
      a.message.localeCompare(b.message),
  );
}

/** Parameter a finding is about, or null. */
export function fieldOf(finding: Finding): string | null {
  const field = finding.context.field;
  if (typeof field !== "string" || !field) return null;
  return field.startsWith("params.") ? (field.slice(7).split(".")[0] ?? null) : field;
}

/** Findings about a step, also those about several of which it is one. */
export function findingsOf(findings: readonly Finding[], stepId: string): Finding[] {
  return findings.filter(({ subject, context }) => {
    if (subject === stepId) return true;
    return Array.isArray(context.steps) && context.steps.includes(stepId);
  });
}

export type RingState = "ok" | "bad" | "waiting";

/** State of each ring: what could not be asked because an inner ring failed is waiting. */
export function ringStates(
  findings: readonly Finding[],
  hasPlan: boolean,
  isFresh: boolean,
): Record<Ring, RingState> {
  const bad = new Set(findings.map(ringOf));
  const state = (ring: Ring, wasAsked: boolean): RingState => {
    if (bad.has(ring)) return "bad";
    return wasAsked ? "ok" : "waiting";
  };
  const read = isFresh && !bad.has("fields");
  return {
    fields: state("fields", isFresh),
    graph: state("graph", isFresh),
    materials: state("materials", read && (hasPlan || bad.has("materials"))),
    resources: state("resources", read && (hasPlan || bad.has("resources"))),
  };
}
