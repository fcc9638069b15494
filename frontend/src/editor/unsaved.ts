/** What was drawn and not yet saved outlives the page: a session may end while one draws. */

import { hashKey } from "@tanstack/react-query";
import { useEffect } from "react";
import { openDocument } from "@/model/opening";
import type { WorkflowDocument } from "@/model/wire";
import { useEditor, type EditorState, type Kept } from "./store";

const keyOf = (owner: string, id: string): string => `labweb.draft/${owner}/${id}`;

/** Whether two documents say the same; the server does not keep the order of names. */
export function isSame(one: unknown, other: unknown): boolean {
  return hashKey([one]) === hashKey([other]);
}

/** The draft that this person left unsaved in this tab. */
export function keptOf(owner: string, id: string): Kept | null {
  const text = sessionStorage.getItem(keyOf(owner, id));
  if (text === null) return null;
  try {
    const kept = JSON.parse(text) as Kept;
    return { ...kept, document: openDocument(kept.document).document };
  } catch {
    // It cannot be read: there is nothing to offer.
    forget(owner, id);
    return null;
  }
}

function keep(owner: string, id: string, kept: Kept): void {
  try {
    sessionStorage.setItem(keyOf(owner, id), JSON.stringify(kept));
  } catch {
    // The browser's room is full. An older state is worse than none.
    forget(owner, id);
  }
}

export function forget(owner: string, id: string): void {
  sessionStorage.removeItem(keyOf(owner, id));
}

/** The server has `document`: what was drawn after it is now a change of the new revision. */
export function settleKept(
  owner: string,
  id: string,
  written: { document: WorkflowDocument; from: number; to: number },
): void {
  const kept = keptOf(owner, id);
  if (!kept) return;
  if (isSame(kept.document, written.document)) forget(owner, id);
  else if (kept.revision === written.from) keep(owner, id, { ...kept, revision: written.to });
}

function follow(state: EditorState, before: EditorState): void {
  const { workflowId, owner, canEdit, offer, history, saving } = state;
  // What is on offer stays until it is answered.
  if (!workflowId || !canEdit || offer) return;
  const isMoved =
    workflowId !== before.workflowId ||
    offer !== before.offer ||
    history.document !== before.history.document ||
    saving.saved !== before.saving.saved;
  if (!isMoved) return;
  if (history.document === saving.saved) forget(owner, workflowId);
  else keep(owner, workflowId, { revision: saving.revision, document: history.document });
}

/** Keep each change at once, until the server has it. */
export function useKeeping(): void {
  useEffect(() => useEditor.subscribe(follow), []);
}

/** Bring back what was left unsaved, as an edit that can be undone; or let it go. */
export function answerOffer(isWanted: boolean): void {
  const { offer, edit, set } = useEditor.getState();
  if (offer && isWanted) {
    const { name, steps, edges } = offer.document;
    edit({
      label: "restore what was not saved",
      apply: (draft) => {
        draft.name = name;
        draft.steps = steps;
        draft.edges = edges;
      },
    });
  }
  set({ offer: null });
}
