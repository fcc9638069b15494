// @vitest-environment jsdom
// With LABWEB_DOCUMENTS, a file of what the server accepts: `{steps, documents}`.
import { readFileSync } from "node:fs";
import { act, screen } from "@testing-library/react";
import { expect, test } from "vitest";
import { Route, Routes } from "react-router";
import { aDocument, OPERATIONS } from "@/model/samples";
import type { UnitOperation, Workflow, WorkflowDocument } from "@/model/wire";
import { serve, show } from "@/testpage";
import { EditorPage } from "./page";
import { useEditor } from "./store";

interface Corpus {
  steps: UnitOperation[];
  documents: unknown[];
}

const FILE = process.env.LABWEB_DOCUMENTS;
const CORPUS: Corpus = FILE
  ? (JSON.parse(readFileSync(FILE, "utf-8")) as Corpus)
  : {
      steps: OPERATIONS,
      documents: [
        aDocument(),
        { steps: [] },
        { steps: [{ id: "a", kind: "transfer" }] },
        { steps: [{ id: "a", kind: "gone_since", params: { x: [1, null, { y: {} }] } }] },
        { steps: [{ id: "constructor", kind: "constructor" }] },
      ],
    };

const workflow = (draft: unknown): Workflow => ({
  id: "w1",
  name: "Any",
  description: "",
  is_template: false,
  latest_version: null,
  steps_count: 0,
  updated_at: "2027-01-15T08:00:00Z",
  updated_by: null,
  last_run: null,
  draft: draft as WorkflowDocument,
  draft_revision: 1,
  versions: [],
  can_edit: true,
});

const ANSWERS: Record<string, unknown> = {
  "/steps": { steps: CORPUS.steps, devices: [], units: {} },
  "/resources": { resources: [] },
  "/session": { user: { username: "chemist" }, lab: null },
  "/workflows/check": {
    findings: [],
    plan: null,
    policies: [],
    sentences: {},
    dead_volume_nl: {},
    proof: null,
  },
};

async function open(draft: unknown): Promise<() => void> {
  serve((path) => [200, path === "/workflows/w1" ? workflow(draft) : (ANSWERS[path] ?? {})]);
  useEditor.getState().set({ workflowId: "" });
  const { unmount } = show(
    <Routes>
      <Route path="/workflows/:id/edit" element={<EditorPage />} />
    </Routes>,
    "/workflows/w1/edit",
  );
  return unmount;
}

test(
  "every document that the server accepts opens, on the canvas, in the list and in the form",
  { timeout: 240_000 },
  async () => {
    expect(CORPUS.documents.length).toBeGreaterThan(4);
    for (const draft of CORPUS.documents) {
      const close = await open(draft);
      await screen.findByTestId("editor", {}, { timeout: 10_000 });
      const { history, select, set } = useEditor.getState();
      const wanted = (draft as WorkflowDocument).steps.map((step) => step.id);
      expect(history.document.steps.map((step) => step.id)).toEqual(wanted);
      for (const id of wanted) {
        act(() => select([id]));
        expect(screen.getByTestId("inspector")).toBeVisible();
      }
      act(() => set({ view: "list" }));
      for (const list of screen.queryAllByTestId("step-list")) {
        expect(list.children).toHaveLength(wanted.length);
      }
      expect(useEditor.getState().history.document).toBe(useEditor.getState().saving.saved);
      act(() => set({ view: "canvas" }));
      close();
    }
  },
);
