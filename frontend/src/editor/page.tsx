/** The editor: shelves, canvas, form, and one line of findings. */

import "@xyflow/react/dist/style.css";
import "./editor.css";
import { ReactFlowProvider, useReactFlow } from "@xyflow/react";
import { useEffect, useMemo, useState } from "react";
import { useParams } from "react-router";
import { useAct } from "@/api/act";
import { keys } from "@/api/keys";
import { client, useTopics } from "@/api/live";
import { useResources, useSession, useSteps, useWorkflow } from "@/api/queries";
import type { Workflow } from "@/model/wire";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { PageState } from "@/ui/pagestate";
import { Canvas } from "./canvas";
import { useChecking, useCheckNow } from "./check";
import { ConnectMenu } from "./connectmenu";
import { FindingsBar } from "./findingsbar";
import { EditorHead } from "./header";
import { Inspector } from "./inspector";
import { useEditorKeys } from "./keys";
import { ListView } from "./listview";
import { Palette } from "./palette";
import { Notice, Questions } from "./questions";
import { RunSheet } from "./runsheet";
import { hearOf, saveSeen, useAutosave } from "./saving";
import { useEditor } from "./store";
import { isSame, keptOf, useKeeping } from "./unsaved";
import { words } from "./words";

export function EditorPage() {
  const { id = "" } = useParams();
  const workflow = useWorkflow(id);
  // A draft from the cache may be older than one's own last save.
  if (workflow.data && workflow.isFetchedAfterMount) {
    return (
      <ReactFlowProvider>
        <Editor workflow={workflow.data} key={id} />
      </ReactFlowProvider>
    );
  }
  return <PageState of="workflow" error={workflow.error} retry={workflow.refetch} />;
}

type Sheet = "run" | "save" | "connect" | null;

function Editor({ workflow }: { workflow: Workflow }) {
  const [sheet, setSheet] = useState<Sheet>(null);
  // Before `useOpen`: what is left is saved before the store forgets what it is of.
  useAutosave();
  useKeeping();
  const isOpen = useOpen(workflow);
  const view = useEditor((state) => state.view);
  const flow = useReactFlow();
  const checkNow = useCheckNow();
  useTopics("workflows", "events", "devices");
  useChecking();
  const acts = useMemo(
    () => ({
      onCheck: () => void checkNow(),
      onRun: () => setSheet("run"),
      onSaveVersion: () => setSheet("save"),
      onConnect: () => setSheet("connect"),
      onFit: () => void flow.fitView({ maxZoom: 1, padding: 0.08 }),
    }),
    [checkNow, flow],
  );
  useEditorKeys(acts);
  if (!isOpen) return null;
  return (
    <div className="editor" data-testid="editor">
      <EditorHead
        workflow={workflow}
        onCheck={acts.onCheck}
        onSave={acts.onSaveVersion}
        onRun={acts.onRun}
      />
      <div>
        <Questions />
        <Notice />
      </div>
      <div className="panes wide">
        <Palette />
        {view === "canvas" ? (
          <Canvas />
        ) : (
          <div className="listpane">
            <ListView />
          </div>
        )}
        <Inspector onConnect={acts.onConnect} />
      </div>
      <div className="phone phonelist">
        <ListView />
      </div>
      <FindingsBar />
      <RunSheet isOpen={sheet === "run"} onClose={() => setSheet(null)} />
      <SaveSheet isOpen={sheet === "save"} onClose={() => setSheet(null)} />
      <ConnectMenu isOpen={sheet === "connect"} onClose={() => setSheet(null)} />
    </div>
  );
}

/** Put the workflow and what the lab offers into the store. */
function useOpen(workflow: Workflow): boolean {
  const steps = useSteps().data;
  const resources = useResources().data;
  const owner = useSession().data?.user?.username ?? "";
  const openId = useEditor((state) => state.workflowId);
  const revision = useEditor((state) => state.saving.revision);
  const isBusy = useEditor((state) => state.saving.isBusy);
  useEffect(() => {
    const { workflowId, open } = useEditor.getState();
    if (workflowId === workflow.id) return hearOf(workflow);
    const kept = keptOf(owner, workflow.id);
    open(workflow, owner, kept && isSame(kept.document, workflow.draft) ? null : kept);
  }, [workflow, owner, revision, isBusy]);
  useEffect(() => () => useEditor.getState().set({ workflowId: "" }), []);
  useEffect(() => useEditor.getState().setLab(steps, resources), [steps, resources]);
  return openId === workflow.id;
}

function SaveSheet(props: { isOpen: boolean; onClose: () => void }) {
  const [note, setNote] = useState("");
  const save = useAct({
    mutationFn: () => saveSeen(note.trim()),
    onSuccess: () => {
      void client.invalidateQueries({ queryKey: keys.workflows });
      setNote("");
      props.onClose();
    },
  });
  return (
    <Dialog title={words.editor.save} isOpen={props.isOpen} onClose={props.onClose}>
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          save.mutate();
        }}
      >
        <TextField
          label="What changed, in one line"
          value={note}
          onChange={setNote}
          autoFocus
          testId="version-note"
        />
        <Refused error={save.error} />
        <div className="acts">
          <Button large onClick={props.onClose}>
            Cancel
          </Button>
          <Button
            large
            look="pri"
            type="submit"
            testId="save-version-confirm"
            disabled={save.isPending}
          >
            {words.editor.save}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}
