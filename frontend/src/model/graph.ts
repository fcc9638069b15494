/** What may be wired to what, and in which order steps come. */

import { findStep, portKind, type Palette, type PortRef } from "./document";
import type { Finding, PortKind, WorkflowDocument } from "./wire";

const PORT_WORDS: Record<PortKind, string> = {
  done: "an order (▸)",
  material: "a vessel (●)",
  data: "a value (◆)",
};

/** Reason why two ports cannot be wired, or null when they can. */
export function whyNotConnect(
  palette: Palette,
  document: WorkflowDocument,
  from: PortRef,
  into: PortRef,
): string | null {
  if (from.step === into.step) return "A step cannot be wired to itself.";
  const out = portKind(palette, document, from, "out");
  const wanted = portKind(palette, document, into, "in");
  if (!out || !wanted) return "There is no such port.";
  if (out !== wanted) return `This gives ${PORT_WORDS[out]}, that wants ${PORT_WORDS[wanted]}.`;
  const twin = document.edges.some(
    (e) =>
      e.source === from.step &&
      e.source_port === from.port &&
      e.target === into.step &&
      e.target_port === into.port,
  );
  if (twin) return "They are wired already.";
  if (wanted === "material") {
    const fed = document.edges.some((e) => e.target === into.step && e.target_port === into.port);
    if (fed) return "This vessel already comes from another step.";
    const leaves = findStep(document, from.step)?.params[from.port];
    const enters = findStep(document, into.step)?.params[into.port];
    if (leaves !== undefined && enters !== undefined && leaves !== enters) {
      return "The two steps name different vessels.";
    }
  }
  if (reaches(document, into.step, from.step)) return "This would make a circle.";
  return null;
}

/** Tell whether `to` comes after `from`. */
export function reaches(document: WorkflowDocument, from: string, to: string): boolean {
  const seen = new Set<string>();
  const open = [from];
  for (let step = open.pop(); step !== undefined; step = open.pop()) {
    if (step === to) return true;
    if (seen.has(step)) continue;
    seen.add(step);
    for (const edge of document.edges) if (edge.source === step) open.push(edge.target);
  }
  return false;
}

/** Ids of the steps, each after all it waits for; steps of a ring come last, as drawn. */
export function orderSteps(document: WorkflowDocument): string[] {
  const ids = document.steps.map((step) => step.id);
  const known = new Set(ids);
  const waits = new Map(ids.map((id) => [id, new Set<string>()]));
  for (const edge of document.edges) {
    if (known.has(edge.source)) waits.get(edge.target)?.add(edge.source);
  }
  const order: string[] = [];
  const placed = new Set<string>();
  for (;;) {
    const next = ids.find(
      (id) => !placed.has(id) && [...(waits.get(id) ?? [])].every((w) => placed.has(w)),
    );
    if (next === undefined) break;
    order.push(next);
    placed.add(next);
  }
  return [...order, ...ids.filter((id) => !placed.has(id))];
}

/** Every port a wire from `from` may end at, or why not. */
export function findTargets(
  palette: Palette,
  document: WorkflowDocument,
  from: PortRef,
): { into: PortRef; label: string; reason: string | null }[] {
  return document.steps
    .filter((step) => step.id !== from.step)
    .flatMap((step) =>
      (palette.get(step.kind)?.inputs ?? []).map((port) => {
        const into = { step: step.id, port: port.name };
        return { into, label: port.label, reason: whyNotConnect(palette, document, from, into) };
      }),
    );
}

/** What the browser itself can say about the graph, at once. */
export function checkGraph(palette: Palette, document: WorkflowDocument): Finding[] {
  const findings: Finding[] = [];
  for (const edge of document.edges) {
    const out = portKind(palette, document, { step: edge.source, port: edge.source_port }, "out");
    const into = portKind(palette, document, { step: edge.target, port: edge.target_port }, "in");
    if (!out || !into || out !== into) {
      findings.push({
        code: "protocol.port_types",
        message: "A connection joins ports of different sorts.",
        subject: edge.target,
        context: { field: "edges" },
      });
    }
  }
  for (const step of document.steps) {
    if (palette.size && !palette.has(step.kind)) {
      findings.push({
        code: "protocol.unknown_kind",
        message: `Nothing here can do “${step.kind}”.`,
        subject: step.id,
        context: { field: "kind" },
      });
    }
  }
  return findings;
}
