/** Acts on steps that several parts of the editor share. */

import {
  addStep,
  copySteps,
  freeStepId,
  makeStep,
  moveSteps,
  parseClip,
  pasteClip,
  placeAfter,
} from "@/model/document";
import { layoutBoxes } from "@/model/layout";
import { removedText, removeSteps } from "@/model/removing";
import { useEditor } from "./store";

/** Sort of what is dragged from the palette to the canvas. */
export const DRAG_TYPE = "application/x-labweb-step";

const DEVICE_ACTION = "device_action";

/** What the palette hands over: a kind of step, or an action of a device. */
export function paletteItem(kind: string, deviceId?: string, action?: string): string {
  return JSON.stringify({ kind, deviceId, action });
}

/** Add what was picked in the palette: after the selected step, or where it was dropped. */
export function addFromPalette(item: string, position?: { x: number; y: number }): void {
  const { kind, deviceId, action } = JSON.parse(item) as {
    kind: string;
    deviceId?: string;
    action?: string;
  };
  const state = useEditor.getState();
  const { document } = state.history;
  const after = position ? null : (state.selection.at(-1) ?? document.steps.at(-1)?.id ?? null);
  const params: Record<string, unknown> = {};
  if (kind === DEVICE_ACTION && deviceId) {
    const node = state.resources.find((row) => row.device?.id === deviceId);
    if (node) params.device = node.id;
    if (action) params.action = action;
  }
  const step = makeStep(
    freeStepId(document, kind),
    kind,
    params,
    position ?? placeAfter(document, after),
  );
  state.edit(addStep(step, state.palette.get(kind)?.label ?? kind, after));
  state.select([step.id]);
}

/** Delete the picked steps and say what leads where since; tells whether any were picked. */
export function deleteSelection(): boolean {
  const { selection, history, canEdit, edit, set } = useEditor.getState();
  if (!selection.length || !canEdit) return false;
  edit(removeSteps(selection));
  set({ notice: removedText(history.document, selection) });
  return true;
}

export function duplicateSelection(): void {
  const { selection, history, edit, select } = useEditor.getState();
  if (!selection.length) return;
  const { edit: paste, ids } = pasteClip(history.document, copySteps(history.document, selection));
  edit({ ...paste, label: "duplicate" });
  select(ids);
}

/** Selected steps as text, or null when nothing is selected. */
export function copyText(): string | null {
  const { selection, history } = useEditor.getState();
  if (!selection.length) return null;
  return JSON.stringify(copySteps(history.document, selection), null, 1);
}

/** Paste steps from text; tells whether the text held any. */
export function pasteText(text: string): boolean {
  const { history, edit, select } = useEditor.getState();
  const clip = parseClip(text);
  if (!clip) return false;
  const { edit: paste, ids } = pasteClip(history.document, clip);
  edit(paste);
  select(ids);
  return true;
}

export function nudgeSelection(dx: number, dy: number): void {
  const { selection, history, edit } = useEditor.getState();
  const moved = history.document.steps
    .filter((step) => selection.includes(step.id))
    .map((step) => [step.id, { x: step.position.x + dx, y: step.position.y + dy }] as const);
  if (moved.length) edit(moveSteps(new Map(moved), undefined, "nudge"));
}

/** Lay all steps out from left to right; only ever on request. */
export function tidy(): void {
  const { history, edit } = useEditor.getState();
  const { steps, edges } = history.document;
  const boxes = steps.map((step) => ({ id: step.id, width: 212, height: 104 }));
  const places = layoutBoxes(boxes, edges, { rank: 64, node: 40 });
  edit(moveSteps(places, "tidy"));
}
