/** Head of the editor: name, version, whether it is saved, undo, check and run. */

import { Menu } from "@mantine/core";
import { Link } from "react-router";
import { fetchVersion } from "@/api/workflows";
import { renameWorkflow } from "@/model/document";
import { redoLabel, undoLabel } from "@/model/history";
import type { Version, Workflow } from "@/model/wire";
import { Button, IconButton, Segments } from "@/ui/controls";
import { Icon } from "@/ui/icons";
import { useLabTime } from "@/ui/time";
import { useVerdict } from "./check";
import { useDocument, useEditor } from "./store";
import { words } from "./words";

const VIEWS = [
  { value: "canvas", label: "Canvas" },
  { value: "list", label: "List" },
] as const;

export function EditorHead(props: {
  workflow: Workflow;
  onCheck: () => void;
  onSave: () => void;
  onRun: () => void;
}) {
  const document = useDocument();
  const { view, canEdit, edit, set } = useEditor();
  return (
    <header className="eh">
      <Link className="crumb wide" to="/workflows">
        {words.list.title}
      </Link>
      <span className="crumb wide">/</span>
      <h1>
        {canEdit ? (
          <input
            className="wname"
            aria-label="Name of the workflow"
            data-testid="workflow-name"
            value={document.name}
            maxLength={200}
            size={Math.max(8, document.name.length)}
            onChange={(event) => edit(renameWorkflow(event.target.value))}
          />
        ) : (
          document.name
        )}
      </h1>
      <Versions workflow={props.workflow} />
      <SavedText />
      <span className="phone t12 s full">{words.editor.readOnlyPhone}</span>
      <i className="sp wide" />
      <span className="wide ehacts">
        {!canEdit && (
          <span className="t12 s lockd">
            <Icon name="lock" size={14} />
            {words.editor.readOnly}
          </span>
        )}
        <UndoRedo />
        <Segments
          label="View"
          value={view}
          options={VIEWS}
          onChange={(value) => set({ view: value })}
        />
        <Button large onClick={props.onCheck} testId="check">
          {words.editor.check} <kbd>Ctrl ↵</kbd>
        </Button>
        <Button
          large
          onClick={props.onSave}
          testId="save-version"
          why={canEdit ? null : words.editor.readOnly}
        >
          {words.editor.save}
        </Button>
        <Button large look="pri" onClick={props.onRun} testId="run">
          {words.editor.run}
        </Button>
      </span>
    </header>
  );
}

function UndoRedo() {
  const history = useEditor((state) => state.history);
  const { undo, redo, canEdit } = useEditor.getState();
  const back = undoLabel(history);
  const forth = redoLabel(history);
  return (
    <>
      <IconButton
        icon="undo"
        label={back ? `Undo: ${back}` : "Nothing to undo"}
        disabled={!back || !canEdit}
        onClick={undo}
        testId="undo"
      />
      <IconButton
        icon="redo"
        label={forth ? `Redo: ${forth}` : "Nothing to redo"}
        disabled={!forth || !canEdit}
        onClick={redo}
        testId="redo"
      />
    </>
  );
}

function SavedText() {
  const { saving, canEdit } = useEditor();
  const document = useDocument();
  const { result } = useVerdict();
  const time = useLabTime();
  if (!canEdit) return null;
  const isSaved = saving.saved === document && saving.conflict === null;
  const text = saving.problem
    ? `${words.editor.unsaved}: ${saving.problem}`
    : saving.conflict !== null
      ? words.editor.unsaved
      : isSaved
        ? saving.savedAt
          ? `saved ${time.second(saving.savedAt)}`
          : "saved"
        : words.editor.saving;
  return (
    <span
      className={`t12 wide num cut ${saving.problem ? "err" : "m"}`}
      data-testid="saved"
      data-state={isSaved ? "saved" : "unsaved"}
      data-checked={result !== null}
      role={saving.problem ? "alert" : undefined}
    >
      {text}
    </span>
  );
}

function Versions({ workflow }: { workflow: Workflow }) {
  const time = useLabTime();
  const { canEdit, edit } = useEditor();
  const latest = workflow.versions[0];
  const restore = async (version: Version): Promise<void> => {
    const full = await fetchVersion(workflow.id, version.number);
    const { document } = full;
    if (!document) return;
    edit({
      label: `restore v${version.number}`,
      apply: (draft) => {
        draft.name = document.name;
        draft.steps = document.steps;
        draft.edges = document.edges;
      },
    });
  };
  return (
    <Menu position="bottom-start" width={320}>
      <Menu.Target>
        <button type="button" className="chip sq vchip" data-testid="versions">
          <b className="b num">{latest ? `v${latest.number}` : "no version"}</b>
          <span className="m">{latest ? "and draft" : "draft only"}</span>
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.Label>{canEdit ? "Bring back as draft" : "Versions"}</Menu.Label>
        {workflow.versions.map((version) => (
          <Menu.Item
            key={version.id}
            disabled={!canEdit}
            onClick={() => void restore(version)}
            rightSection={
              <span className="t12 m num">{time.near(version.at, Date.now() / 1000)}</span>
            }
          >
            <b className="b num">v{version.number}</b> {version.note || "no note"}{" "}
            <span className="m">{version.author}</span>
          </Menu.Item>
        ))}
        {workflow.versions.length === 0 && <Menu.Item disabled>No version yet</Menu.Item>}
      </Menu.Dropdown>
    </Menu>
  );
}
