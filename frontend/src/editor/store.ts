/** State of the open editor: document with its history, selection, check, saving. */

import { create } from "zustand";
import { makePalette, type Edit, type Palette, type PortRef } from "@/model/document";
import { applyEdit, redo, startHistory, undo, type History } from "@/model/history";
import { namesOf, type Names } from "@/model/sentence";
import type { UnitTables } from "@/model/quantity";
import type {
  CheckResult,
  PaletteDevice,
  ResourceRow,
  Steps,
  Workflow,
  WorkflowDocument,
} from "@/model/wire";

export type View = "canvas" | "list";

interface Saving {
  revision: number;
  /** The document as the server has it. */
  saved: WorkflowDocument;
  savedAt: number | null;
  isBusy: boolean;
  problem: string | null;
  /** Revision of somebody else's draft that stands in the way. */
  conflict: number | null;
}

/** What was drawn upon a revision and did not reach the server. */
export interface Kept {
  revision: number;
  document: WorkflowDocument;
}

interface Checked {
  /** What was checked, as text without positions. */
  content: string;
  result: CheckResult;
  at: number;
}

export interface EditorState {
  workflowId: string;
  /** Who draws. */
  owner: string;
  /** What this person left unsaved, as long as nobody said what becomes of it. */
  offer: Kept | null;
  history: History;
  canEdit: boolean;
  selection: string[];
  view: View;
  saving: Saving;
  checked: Checked | null;
  checkProblem: string | null;
  palette: Palette;
  devices: PaletteDevice[];
  units: UnitTables;
  resources: ResourceRow[];
  names: Names;
  connectFrom: PortRef | null;
  hint: string | null;
  /** What the last edit did besides what was asked for; gone with the next one. */
  notice: string | null;
  /** Field that should take the focus, from a finding. */
  focusField: string | null;
  open: (workflow: Workflow, owner: string, kept?: Kept | null) => void;
  setLab: (steps: Steps | undefined, resources: ResourceRow[] | undefined) => void;
  edit: (edit: Edit) => void;
  undo: () => void;
  redo: () => void;
  select: (ids: string[], field?: string | null) => void;
  set: (part: Partial<EditorState>) => void;
  setSaving: (part: Partial<Saving>) => void;
}

const NOTHING: WorkflowDocument = { schema: "labweb.workflow/1", name: "", steps: [], edges: [] };
const now = (): number => Date.now() / 1000;

function keepKnown(selection: string[], document: WorkflowDocument): string[] {
  const known = new Set(document.steps.map((step) => step.id));
  const kept = selection.filter((id) => known.has(id));
  return kept.length === selection.length ? selection : kept;
}

export const useEditor = create<EditorState>((set) => ({
  workflowId: "",
  owner: "",
  offer: null,
  history: startHistory(NOTHING),
  canEdit: false,
  selection: [],
  view: "canvas",
  saving: {
    revision: 0,
    saved: NOTHING,
    savedAt: null,
    isBusy: false,
    problem: null,
    conflict: null,
  },
  checked: null,
  checkProblem: null,
  palette: new Map(),
  devices: [],
  units: {},
  resources: [],
  names: new Map(),
  connectFrom: null,
  hint: null,
  notice: null,
  focusField: null,
  open: (workflow, owner, kept = null) =>
    set({
      workflowId: workflow.id,
      owner,
      canEdit: workflow.can_edit,
      selection: [],
      checked: null,
      checkProblem: null,
      connectFrom: null,
      hint: null,
      notice: workflow.draft_notes?.join(" ") ?? null,
      ...opened(workflow, workflow.can_edit ? kept : null),
    }),
  setLab: (steps, resources) =>
    set({
      palette: makePalette(steps?.steps ?? []),
      devices: steps?.devices ?? [],
      units: steps?.units ?? {},
      resources: resources ?? [],
      names: namesOf(resources ?? []),
    }),
  edit: (edit) =>
    set((state) => (state.canEdit ? changed(state, applyEdit(state.history, edit, now())) : state)),
  undo: () => set((state) => changed(state, undo(state.history))),
  redo: () => set((state) => changed(state, redo(state.history))),
  select: (selection, focusField = null) => set({ selection, focusField }),
  set: (part) => set(part),
  setSaving: (part) => set((state) => ({ saving: { ...state.saving, ...part } })),
}));

/** The draft of the server; what was left unsaved is offered, or asked about if both moved on. */
function opened(workflow: Workflow, kept: Kept | null): Partial<EditorState> {
  const { draft, draft_revision: revision } = workflow;
  const isOver = kept !== null && kept.revision !== revision;
  return {
    history: startHistory(isOver ? kept.document : draft),
    offer: isOver ? null : kept,
    saving: {
      revision: isOver ? kept.revision : revision,
      saved: draft,
      savedAt: null,
      isBusy: false,
      problem: null,
      conflict: isOver ? revision : null,
    },
  };
}

function changed(state: EditorState, history: History): Partial<EditorState> {
  return {
    history,
    selection: keepKnown(state.selection, history.document),
    hint: null,
    notice: null,
  };
}

export const useDocument = (): WorkflowDocument => useEditor((state) => state.history.document);

/** The document as text without positions: what a check depends on. */
export function contentOf(document: WorkflowDocument): string {
  return JSON.stringify({
    name: document.name,
    steps: document.steps.map(({ id, kind, params }) => ({ id, kind, params })),
    edges: document.edges,
  });
}
