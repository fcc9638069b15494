/** A document as the server has it becomes one that the editor can show, or a reason why not. */

import { layoutBoxes } from "./layout";
import type { WorkflowDocument, WorkflowEdge, WorkflowStep } from "./wire";

/** A document that no page can show; `at` is the path of the place, such as `steps[3].params`. */
export class UnreadableDocument extends Error {
  readonly at: string;

  constructor(at: string, reason: string) {
    super(`The document cannot be shown: ${at} ${reason}.`);
    this.name = "UnreadableDocument";
    this.at = at;
  }
}

export interface Opened {
  document: WorkflowDocument;
  /** What had to be left out or moved so that it can be shown, in sentences. */
  notes: string[];
}

/** No step is drawn farther from the middle than this, in pixels. */
const FARTHEST = 1_000_000;
/** A kind is the stem of the ids of pasted steps. */
const KIND = /^[A-Za-z][A-Za-z0-9_]{0,59}$/;
const BOX = { width: 212, height: 104 };
const GAPS = { rank: 64, node: 40 };
const ENDS = ["id", "source", "source_port", "target", "target_port"] as const;

/**
 * Read a document. What may be left out is filled in: no connections, no parameters, a place on
 * the canvas for steps without one.
 *
 * @throws UnreadableDocument: a part of it is of another sort than it has to be.
 */
export function openDocument(value: unknown): Opened {
  const notes: string[] = [];
  const head = objectAt(value, "document");
  const name = head.name === undefined ? "" : textAt(head.name, "name");
  const raw = listAt(head.steps, "steps").map(stepAt);
  const ids = new Set<string>();
  for (const [place, step] of raw.entries()) {
    if (ids.has(step.id)) throw new UnreadableDocument(`steps[${place}].id`, "is there twice");
    ids.add(step.id);
  }
  const read = (head.edges === undefined ? [] : listAt(head.edges, "edges")).map(edgeAt);
  const edges = read.filter((edge, place) => {
    if (!ids.has(edge.source) || !ids.has(edge.target)) {
      notes.push(`Connection ${edge.id} led to a step that is not there. It was left out.`);
      return false;
    }
    if (read.findIndex((one) => one.id === edge.id) < place) {
      notes.push(`There were two connections ${edge.id}. The second was left out.`);
      return false;
    }
    return true;
  });
  const steps = placed(raw, edges, notes);
  const schema = head.schema === undefined ? "labweb.workflow/1" : textAt(head.schema, "schema");
  return { document: { ...head, schema, name, steps, edges }, notes };
}

/** Tell whether this can be a step; what is pasted may be anything. */
export function isStep(value: unknown): value is WorkflowStep {
  try {
    const { kind, position } = stepAt(value, 0);
    const { params } = value as Partial<WorkflowStep>;
    return KIND.test(kind) && position !== null && params !== undefined;
  } catch {
    return false;
  }
}

export function isEdge(value: unknown): value is WorkflowEdge {
  try {
    return Boolean(edgeAt(value, 0));
  } catch {
    return false;
  }
}

type Fields = Record<string, unknown>;
type Unplaced = Omit<WorkflowStep, "position"> & { position: { x: number; y: number } | null };

function stepAt(value: unknown, place: number): Unplaced {
  const at = `steps[${place}]`;
  const raw = objectAt(value, at);
  const id = textAt(raw.id, `${at}.id`);
  const kind = textAt(raw.kind, `${at}.kind`);
  const params = raw.params === undefined ? {} : objectAt(raw.params, `${at}.params`);
  const note = raw.note === undefined ? "" : textAt(raw.note, `${at}.note`);
  const position = positionOf(raw.position);
  return { id, kind, params, position, ...(note ? { note } : {}) };
}

function edgeAt(value: unknown, place: number): WorkflowEdge {
  const at = `edges[${place}]`;
  const raw = objectAt(value, at);
  const [id, source, source_port, target, target_port] = ENDS.map((name) =>
    textAt(raw[name], `${at}.${name}`),
  ) as [string, string, string, string, string];
  return { id, source, source_port, target, target_port };
}

function positionOf(value: unknown): { x: number; y: number } | null {
  if (typeof value !== "object" || value === null) return null;
  const { x, y } = value as Fields;
  return isOnCanvas(x) && isOnCanvas(y) ? { x, y } : null;
}

function isOnCanvas(value: unknown): value is number {
  return typeof value === "number" && Math.abs(value) <= FARTHEST;
}

/** All have places, or those without one are laid out below the others. */
function placed(steps: Unplaced[], edges: WorkflowEdge[], notes: string[]): WorkflowStep[] {
  const known = steps.flatMap((step) => (step.position ? [step.position.y] : []));
  if (known.length === steps.length) return steps as WorkflowStep[];
  const below = known.length ? Math.max(...known) + 2 * BOX.height : 0;
  const loose = steps.filter((step) => !step.position).map(({ id }) => ({ id, ...BOX }));
  const spots = layoutBoxes(loose, edges, GAPS);
  if (known.length) notes.push("Steps without a place on the canvas stand below the others.");
  return steps.map((step) => {
    const spot = spots.get(step.id) ?? { x: 0, y: 0 };
    return { ...step, position: step.position ?? { x: spot.x, y: spot.y + below } };
  });
}

function objectAt(value: unknown, at: string): Fields {
  if (typeof value === "object" && value !== null && !Array.isArray(value)) return value as Fields;
  throw new UnreadableDocument(at, "is no object");
}

function listAt(value: unknown, at: string): unknown[] {
  if (Array.isArray(value)) return value;
  throw new UnreadableDocument(at, "is no list");
}

function textAt(value: unknown, at: string): string {
  if (typeof value === "string") return value;
  throw new UnreadableDocument(at, "is no text");
}
