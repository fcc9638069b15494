/** The draft is kept every two seconds; somebody else's draft is never overwritten unasked. */

import { useEffect } from "react";
import { ApiError, messageOf } from "@/api/client";
import { saveDraft, saveVersion } from "@/api/commands";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import type { Version, Workflow, WorkflowDocument } from "@/model/wire";
import { useEditor } from "./store";
import { isSame, settleKept } from "./unsaved";
import { words } from "./words";

const EVERY_MS = 2000;

/** The newest revision of each workflow that this tab wrote. */
const written = new Map<string, number>();

export function isSaved(): boolean {
  const { history, saving } = useEditor.getState();
  return history.document === saving.saved;
}

/** Save the draft now; resolves to whether the server has the present document. */
export async function flushDraft(): Promise<boolean> {
  const { workflowId, history, saving, canEdit, setSaving } = useEditor.getState();
  if (saving.conflict !== null) return false;
  if (!workflowId || !canEdit || saving.isBusy) return isSaved();
  if (history.document === saving.saved) return true;
  setSaving({ isBusy: true });
  const isOpen = (): boolean => useEditor.getState().workflowId === workflowId;
  try {
    const { revision } = await saveDraft(workflowId, history.document, saving.revision);
    noteWritten(workflowId, history.document, saving.revision, revision);
  } catch (error) {
    if (isOpen() && !noteRevision(error)) setSaving({ problem: messageOf(error) });
  } finally {
    if (isOpen()) setSaving({ isBusy: false });
  }
  return !isOpen() || (isSaved() && useEditor.getState().saving.conflict === null);
}

function noteWritten(id: string, document: WorkflowDocument, from: number, to: number): void {
  const { workflowId, owner, setSaving } = useEditor.getState();
  written.set(id, to);
  if (workflowId === id)
    setSaving({ revision: to, saved: document, savedAt: Date.now() / 1000, problem: null });
  settleKept(owner, id, { document, from, to });
  client.setQueryData(
    keys.workflow(id),
    (old: Workflow | undefined) => old && { ...old, draft: document, draft_revision: to },
  );
}

/** Note a refusal because somebody else saved; tells whether it was one. */
export function noteRevision(error: unknown): boolean {
  if (!(error instanceof ApiError) || error.code !== "workflow.revision") return false;
  const { history, saving, setSaving } = useEditor.getState();
  const { revision, document } = error.refusal.context;
  const theirs = typeof revision === "number" ? revision : saving.revision + 1;
  if (isSame(document, history.document))
    setSaving({ revision: theirs, saved: history.document, problem: null });
  else setSaving({ conflict: theirs });
  return true;
}

/** The server has a draft: when it is newer than the page, ask; who only looks is shown it. */
export function hearOf(workflow: Workflow): void {
  const { workflowId, owner, offer, history, saving, canEdit, open, setSaving } =
    useEditor.getState();
  const theirs = workflow.draft_revision;
  if (workflow.id !== workflowId || saving.isBusy || theirs <= saving.revision) return;
  const isOwn = written.get(workflowId) === theirs && saving.conflict === null;
  if (isSame(workflow.draft, history.document))
    setSaving({ revision: theirs, saved: history.document, problem: null, conflict: null });
  else if (!canEdit || (isSaved() && (isOwn || offer))) open(workflow, owner, offer);
  else if (saving.conflict !== theirs) setSaving({ conflict: theirs });
}

/** Save until the server has the present document, or say that it cannot. */
export async function flushAll(): Promise<boolean> {
  for (let attempt = 0; attempt < 5; attempt += 1) {
    while (useEditor.getState().saving.isBusy) {
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
    if (await flushDraft()) return true;
    const { conflict, problem } = useEditor.getState().saving;
    if (conflict !== null || problem !== null) return false;
  }
  return false;
}

/** Save what is on the page, or throw a sentence that says why it cannot be. */
export async function flushOrThrow(): Promise<void> {
  if (await flushAll()) return;
  const isConflict = useEditor.getState().saving.conflict !== null;
  throw new Error(isConflict ? words.editor.conflict : "The draft could not be saved.");
}

/** Freeze what is on the page as a version; refused when somebody saved in between. */
export async function saveSeen(note: string): Promise<Version> {
  await flushOrThrow();
  const { workflowId, saving } = useEditor.getState();
  try {
    return await saveVersion(workflowId, note, saving.revision);
  } catch (error) {
    noteRevision(error);
    throw error;
  }
}

export function useAutosave(): void {
  useEffect(() => {
    const timer = setInterval(() => void flushDraft(), EVERY_MS);
    const onLeave = (event: BeforeUnloadEvent): void => {
      if (isSaved()) return;
      void flushDraft();
      event.preventDefault();
    };
    window.addEventListener("beforeunload", onLeave);
    return () => {
      clearInterval(timer);
      window.removeEventListener("beforeunload", onLeave);
      void flushDraft();
    };
  }, []);
}
