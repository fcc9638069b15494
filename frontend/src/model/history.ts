/** Undo and redo on patches: every edit has its inverse and its words. */

import { applyPatches, enablePatches, produceWithPatches, type Patch } from "immer";
import type { Edit } from "./document";
import type { WorkflowDocument } from "./wire";

enablePatches();

interface Entry {
  label: string;
  group: string | null;
  at: number;
  patches: Patch[];
  inverse: Patch[];
}

export interface History {
  document: WorkflowDocument;
  past: readonly Entry[];
  future: readonly Entry[];
}

const MOST_ENTRIES = 500;
/** Typing goes on as one edit while no more than this lies between two strokes. */
const BURST_S = 2;

export function startHistory(document: WorkflowDocument): History {
  return { document, past: [], future: [] };
}

/** Apply an edit at a time in seconds; an edit that changes nothing leaves no trace. */
export function applyEdit(history: History, edit: Edit, at: number): History {
  const [document, patches, inverse] = produceWithPatches(history.document, edit.apply);
  if (patches.length === 0) return history;
  const last = history.past.at(-1);
  const group = edit.group ?? null;
  if (last && group !== null && last.group === group && at - last.at < BURST_S) {
    const merged: Entry = {
      label: edit.label,
      group,
      at,
      patches: [...last.patches, ...patches],
      inverse: [...inverse, ...last.inverse],
    };
    return { document, past: [...history.past.slice(0, -1), merged], future: [] };
  }
  const entry: Entry = { label: edit.label, group, at, patches, inverse };
  return { document, past: [...history.past.slice(-MOST_ENTRIES + 1), entry], future: [] };
}

export function undo(history: History): History {
  const entry = history.past.at(-1);
  if (!entry) return history;
  return {
    document: applyPatches(history.document, entry.inverse),
    past: history.past.slice(0, -1),
    future: [entry, ...history.future],
  };
}

export function redo(history: History): History {
  const [entry, ...future] = history.future;
  if (!entry) return history;
  return {
    document: applyPatches(history.document, entry.patches),
    past: [...history.past, { ...entry, group: null }],
    future,
  };
}

export function undoLabel(history: History): string | null {
  return history.past.at(-1)?.label ?? null;
}

export function redoLabel(history: History): string | null {
  return history.future[0]?.label ?? null;
}
