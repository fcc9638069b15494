// @vitest-environment jsdom
import { ReactFlowProvider } from "@xyflow/react";
import { act, fireEvent, screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test } from "vitest";
import { makeStep } from "@/model/document";
import { OPERATIONS } from "@/model/samples";
import type { Workflow, WorkflowDocument } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Canvas } from "./canvas";
import { Inspector } from "./inspector";
import { useEditorKeys } from "./keys";
import { Notice } from "./questions";
import { useEditor } from "./store";

const link = (n: number, source: string, target: string) => ({
  id: `e${n}`,
  source,
  source_port: "done",
  target,
  target_port: "start",
});

const CHAIN: WorkflowDocument = {
  schema: "labweb.workflow/1",
  name: "Chain",
  steps: ["a", "b", "c"].map((id, n) => makeStep(id, "transfer", {}, { x: 300 * n, y: 0 })),
  edges: [link(1, "a", "b"), link(2, "b", "c")],
};

const WORKFLOW: Workflow = {
  id: "w1",
  name: "Chain",
  description: "",
  is_template: false,
  latest_version: null,
  steps_count: 3,
  updated_at: "2027-01-15T08:00:00Z",
  updated_by: null,
  last_run: null,
  draft: CHAIN,
  draft_revision: 1,
  versions: [],
  can_edit: true,
};

const nothing = (): void => undefined;
const ACTS = {
  onCheck: nothing,
  onRun: nothing,
  onSaveVersion: nothing,
  onConnect: nothing,
  onFit: nothing,
};

function Page() {
  useEditorKeys(ACTS);
  return (
    <ReactFlowProvider>
      <Notice />
      <Canvas />
      <Inspector onConnect={nothing} />
    </ReactFlowProvider>
  );
}

const editor = () => useEditor.getState();
const ends = (): string[] => editor().history.document.edges.map((e) => `${e.source}>${e.target}`);

beforeEach(() => {
  serve(() => [200, {}]);
  editor().open(WORKFLOW, "chemist");
  editor().setLab({ steps: OPERATIONS, devices: [], units: {} }, []);
  show(<Page />);
  act(() => editor().select(["b"]));
});

async function expectKeptAndUndone(): Promise<void> {
  expect(ends()).toEqual(["a>c"]);
  expect(await screen.findByTestId("edit-notice")).toHaveTextContent(
    "Step 2 was deleted; step 1 now leads to the former step 3.",
  );
  await userEvent.click(screen.getByTestId("notice-undo"));
  expect(editor().history.document).toEqual(CHAIN);
  expect(screen.queryByTestId("edit-notice")).toBeNull();
}

test("the key Delete keeps the order around a middle step and says so", async () => {
  fireEvent.keyDown(window.document.body, { key: "Delete" });
  await expectKeptAndUndone();
});

test("the menu of the step deletes in the same way", async () => {
  await userEvent.click(screen.getByTestId("step-menu"));
  await userEvent.click(await screen.findByText("Delete"));
  await expectKeptAndUndone();
});

test("cutting a step keeps the order, too", async () => {
  fireEvent(window.document.body, new Event("cut", { bubbles: true, cancelable: true }));
  await expectKeptAndUndone();
});

test("who only looks deletes nothing", () => {
  act(() => editor().open({ ...WORKFLOW, can_edit: false }, "observer"));
  act(() => editor().select(["b"]));
  fireEvent.keyDown(window.document.body, { key: "Delete" });
  expect(editor().history.document).toEqual(CHAIN);
  expect(editor().notice).toBeNull();
});
