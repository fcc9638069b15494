/** What the editor asks or tells: somebody else saved, something is not saved, no longer proved, or what an edit did. */

import { messageOf } from "@/api/client";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import { fetchWorkflow } from "@/api/workflows";
import type { Workflow } from "@/model/wire";
import { Button, IconButton } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { ProofLost } from "./proof";
import { flushAll } from "./saving";
import { useEditor } from "./store";
import { answerOffer } from "./unsaved";
import { words } from "./words";

export function Questions() {
  const conflict = useEditor((state) => state.saving.conflict);
  const offer = useEditor((state) => state.offer);
  const proof = useEditor((state) => state.checked?.result.proof ?? null);
  if (conflict !== null) return <Conflict />;
  if (offer) return <Offer />;
  return proof && <ProofLost proof={proof} />;
}

function Conflict() {
  const workflowId = useEditor((state) => state.workflowId);
  /** Null: it cannot be had, which is told, or another workflow is open by now. */
  const fetchTheirs = async (): Promise<Workflow | null> => {
    const isOpen = (): boolean => useEditor.getState().workflowId === workflowId;
    try {
      const theirs = await fetchWorkflow(workflowId);
      return isOpen() ? theirs : null;
    } catch (error) {
      if (isOpen()) useEditor.getState().setSaving({ problem: messageOf(error) });
      return null;
    }
  };
  const loadTheirs = async (): Promise<void> => {
    const theirs = await fetchTheirs();
    if (!theirs) return;
    client.setQueryData(keys.workflow(workflowId), theirs);
    const { open, owner } = useEditor.getState();
    open(theirs, owner);
  };
  const keepMine = async (): Promise<void> => {
    const theirs = await fetchTheirs();
    if (!theirs) return;
    // The server has theirs: even an unchanged page has something to save now.
    const { setSaving } = useEditor.getState();
    setSaving({ conflict: null, revision: theirs.draft_revision, saved: theirs.draft });
    await flushAll();
  };
  return (
    <div className="conflict" role="alert" data-testid="draft-conflict">
      <Glyph look="needs" />
      <span className="b">{words.editor.conflict}</span>
      <i className="sp" />
      <Button onClick={() => void loadTheirs()} testId="load-theirs">
        {words.editor.loadTheirs}
      </Button>
      <Button onClick={() => void keepMine()} testId="keep-mine">
        {words.editor.keepMine}
      </Button>
    </div>
  );
}

/** What the last edit did besides what was asked for, with the way back. */
export function Notice() {
  const notice = useEditor((state) => state.notice);
  const { undo, set } = useEditor.getState();
  if (!notice) return null;
  return (
    <div className="conflict told" role="status" data-testid="edit-notice">
      <span>{notice}</span>
      <i className="sp" />
      <Button onClick={undo} testId="notice-undo">
        {words.editor.undo}
      </Button>
      <IconButton
        icon="close"
        label={words.editor.closeNotice}
        onClick={() => set({ notice: null })}
      />
    </div>
  );
}

function Offer() {
  return (
    <div className="conflict" role="alert" data-testid="draft-offer">
      <Glyph look="needs" />
      <span className="b">{words.editor.offer}</span>
      <i className="sp" />
      <Button onClick={() => answerOffer(true)} testId="offer-restore">
        {words.editor.restore}
      </Button>
      <Button onClick={() => answerOffer(false)} testId="offer-discard">
        {words.editor.discard}
      </Button>
    </div>
  );
}
