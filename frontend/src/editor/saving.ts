/** The draft is kept every two seconds; somebody else's draft is never overwritten unasked. */

import { useEffect } from "react";
import { ApiError, messageOf } from "@/api/client";
import { saveDraft } from "@/api/commands";
import { useEditor } from "./store";

const EVERY_MS = 2000;

export function isSaved(): boolean {
  const { history, saving } = useEditor.getState();
  return history.document === saving.saved;
}

/** Save the draft now; resolves to whether the server has the present document. */
export async function flushDraft(): Promise<boolean> {
  const { workflowId, history, saving, canEdit, setSaving } = useEditor.getState();
  if (!workflowId || !canEdit || saving.isBusy || saving.conflict !== null) return isSaved();
  if (history.document === saving.saved) return true;
  const { document } = history;
  setSaving({ isBusy: true });
  try {
    const { revision } = await saveDraft(workflowId, document, saving.revision);
    if (useEditor.getState().workflowId !== workflowId) return true;
    setSaving({ revision, saved: document, savedAt: Date.now() / 1000, problem: null });
  } catch (error) {
    if (error instanceof ApiError && error.code === "workflow.revision") {
      const theirs = error.refusal.context.revision;
      setSaving({ conflict: typeof theirs === "number" ? theirs : saving.revision + 1 });
    } else setSaving({ problem: messageOf(error) });
  } finally {
    useEditor.getState().setSaving({ isBusy: false });
  }
  return isSaved();
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
