/** A workflow as it is edited: what may be changed, each change with its words. */

import { isEdge, isStep } from "./opening";
import type { PortKind, UnitOperation, WorkflowDocument, WorkflowEdge, WorkflowStep } from "./wire";

export type Palette = Map<string, UnitOperation>;

/** One change: its words for "Undo …", and what it does to the document. */
export interface Edit {
  label: string;
  /** Edits that follow each other with the same group are one step of undo. */
  group?: string;
  apply: (document: WorkflowDocument) => void;
}

export interface PortRef {
  step: string;
  port: string;
}

const ROW = 32;

export function makePalette(steps: UnitOperation[]): Palette {
  return new Map(steps.map((step) => [step.kind, step]));
}

/** Build a step with its fields in the order of the language. */
export function makeStep(
  id: string,
  kind: string,
  params: Record<string, unknown>,
  position: { x: number; y: number },
  note = "",
): WorkflowStep {
  const at = { x: Math.round(position.x), y: Math.round(position.y) };
  return { id, kind, params, position: at, ...(note ? { note } : {}) };
}

/** First id of this kind that the document does not use: `transfer_2`. */
export function freeStepId(document: WorkflowDocument, kind: string): string {
  return freeId(kind, new Set(document.steps.map((step) => step.id)));
}

export function freeEdgeId(document: WorkflowDocument): string {
  return freeId("e", new Set(document.edges.map((edge) => edge.id)), "");
}

function freeId(stem: string, taken: Set<string>, joint = "_"): string {
  for (let n = 1; ; n += 1) {
    const id = `${stem}${joint}${n}`;
    if (!taken.has(id)) return id;
  }
}

export function findStep(document: WorkflowDocument, id: string): WorkflowStep | undefined {
  return document.steps.find((step) => step.id === id);
}

function replaceStep(
  document: WorkflowDocument,
  id: string,
  change: (step: WorkflowStep) => WorkflowStep,
): void {
  const place = document.steps.findIndex((step) => step.id === id);
  const step = document.steps[place];
  if (step) document.steps[place] = change(step);
}

/** Where a new step stands: right of the one it follows, else below all others. */
export function placeAfter(
  document: WorkflowDocument,
  after: string | null,
): { x: number; y: number } {
  const before = after ? findStep(document, after) : undefined;
  if (before) {
    const spot = { x: before.position.x + 272, y: before.position.y };
    while (document.steps.some((s) => isNear(s.position, spot))) spot.y += 5 * ROW;
    return spot;
  }
  const last = document.steps.at(-1);
  return last ? placeAfter(document, last.id) : { x: 80, y: 80 };
}

function isNear(a: { x: number; y: number }, b: { x: number; y: number }): boolean {
  return Math.abs(a.x - b.x) < 200 && Math.abs(a.y - b.y) < 100;
}

/** Add a step; when `after` is given, it starts when that one is done. */
export function addStep(step: WorkflowStep, label: string, after: string | null): Edit {
  return {
    label: `add ${label}`,
    apply: (document) => {
      document.steps.push(step);
      if (!after || !findStep(document, after)) return;
      document.edges.push({
        id: freeEdgeId(document),
        source: after,
        source_port: "done",
        target: step.id,
        target_port: "start",
      });
    },
  };
}

export function removeEdges(ids: readonly string[]): Edit {
  const gone = new Set(ids);
  return {
    label: gone.size === 1 ? "delete connection" : `delete ${gone.size} connections`,
    apply: (document) => {
      document.edges = document.edges.filter((edge) => !gone.has(edge.id));
    },
  };
}

/** Set a parameter, or take it away with `undefined`; typing in one field is one undo. */
export function setParam(id: string, name: string, label: string, value: unknown): Edit {
  return {
    label: value === undefined ? `clear ${label}` : `set ${label}`,
    group: `param:${id}:${name}`,
    apply: (document) => {
      replaceStep(document, id, (step) => {
        const params = { ...step.params };
        if (value === undefined) Reflect.deleteProperty(params, name);
        else params[name] = value;
        return makeStep(step.id, step.kind, params, step.position, step.note);
      });
    },
  };
}

export function setNote(id: string, note: string): Edit {
  return {
    label: "change note",
    group: `note:${id}`,
    apply: (document) => {
      replaceStep(document, id, (s) => makeStep(s.id, s.kind, s.params, s.position, note));
    },
  };
}

export function renameWorkflow(name: string): Edit {
  return {
    label: "rename workflow",
    group: "name",
    apply: (document) => {
      document.name = name;
    },
  };
}

export function moveSteps(
  to: ReadonlyMap<string, { x: number; y: number }>,
  label = to.size === 1 ? "move step" : `move ${to.size} steps`,
  group?: string,
): Edit {
  return {
    label,
    ...(group ? { group } : {}),
    apply: (document) => {
      for (const [id, position] of to) {
        replaceStep(document, id, (s) => makeStep(s.id, s.kind, s.params, position, s.note));
      }
    },
  };
}

export function connect(from: PortRef, into: PortRef): Edit {
  return {
    label: "connect",
    apply: (document) => {
      document.edges.push({
        id: freeEdgeId(document),
        source: from.step,
        source_port: from.port,
        target: into.step,
        target_port: into.port,
      });
    },
  };
}

/** Move a step one place up or down in the list; the order of ties follows it. */
export function reorderStep(id: string, by: -1 | 1): Edit {
  return {
    label: by < 0 ? "move up" : "move down",
    apply: (document) => {
      const from = document.steps.findIndex((step) => step.id === id);
      const step = document.steps[from];
      const other = document.steps[from + by];
      if (!step || !other) return;
      document.steps[from] = other;
      document.steps[from + by] = step;
    },
  };
}

export interface Clip {
  steps: WorkflowStep[];
  edges: WorkflowEdge[];
}

/** Steps with the connections among them, as text for the clipboard. */
export function copySteps(document: WorkflowDocument, ids: readonly string[]): Clip {
  const kept = new Set(ids);
  return {
    steps: document.steps.filter((step) => kept.has(step.id)),
    edges: document.edges.filter((edge) => kept.has(edge.source) && kept.has(edge.target)),
  };
}

/** Paste under new ids, a little aside; returns the edit and the new ids. */
export function pasteClip(document: WorkflowDocument, clip: Clip): { edit: Edit; ids: string[] } {
  const taken = new Set(document.steps.map((step) => step.id));
  const renamed = new Map<string, string>();
  for (const step of clip.steps) {
    const id = freeId(step.kind, taken);
    taken.add(id);
    renamed.set(step.id, id);
  }
  const count = clip.steps.length;
  const apply = (target: WorkflowDocument): void => {
    for (const step of clip.steps) {
      const at = { x: step.position.x + ROW, y: step.position.y + ROW };
      target.steps.push(
        makeStep(renamed.get(step.id) ?? step.id, step.kind, step.params, at, step.note),
      );
    }
    for (const edge of clip.edges) {
      const source = renamed.get(edge.source);
      const end = renamed.get(edge.target);
      if (!source || !end) continue;
      target.edges.push({ ...edge, id: freeEdgeId(target), source, target: end });
    }
  };
  return {
    edit: { label: count === 1 ? "paste step" : `paste ${count} steps`, apply },
    ids: [...renamed.values()],
  };
}

/** Read text from the clipboard; null when it holds no steps. */
export function parseClip(text: string): Clip | null {
  try {
    const value = JSON.parse(text) as Partial<Clip>;
    if (!Array.isArray(value.steps) || !Array.isArray(value.edges) || !value.steps.length)
      return null;
    return value.steps.every(isStep) && value.edges.every(isEdge) ? (value as Clip) : null;
  } catch {
    return null;
  }
}

/** Kind of a port, or null when the step has none of this name. */
export function portKind(
  palette: Palette,
  document: WorkflowDocument,
  ref: PortRef,
  side: "in" | "out",
): PortKind | null {
  const operation = palette.get(findStep(document, ref.step)?.kind ?? "");
  const ports = side === "in" ? operation?.inputs : operation?.outputs;
  return ports?.find((port) => port.name === ref.port)?.kind ?? null;
}
