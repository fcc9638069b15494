// @vitest-environment jsdom
import { act, screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test, vi } from "vitest";
import { renameWorkflow } from "@/model/document";
import { aDocument } from "@/model/samples";
import type { CheckResult, Finding, Proof, Workflow, WorkflowDocument } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Questions } from "./questions";
import { RunSheet } from "./runsheet";
import { flushDraft, hearOf, saveSeen } from "./saving";
import { useEditor } from "./store";
import { answerOffer, keptOf, useKeeping } from "./unsaved";
import { words } from "./words";

const named = (name: string): WorkflowDocument => ({ ...aDocument(), name });

function aWorkflow(change: Partial<Workflow> = {}): Workflow {
  return {
    id: "w1",
    name: "Mine",
    description: "",
    is_template: false,
    latest_version: null,
    steps_count: 2,
    updated_at: "2027-01-15T08:00:00Z",
    updated_by: null,
    last_run: null,
    draft: named("Mine"),
    draft_revision: 1,
    versions: [],
    can_edit: true,
    ...change,
  };
}

const THEIRS = { draft: named("Theirs"), draft_revision: 2 };
const editor = () => useEditor.getState();
const refused = (code: string, context: object = {}): [number, unknown] => [
  409,
  { code, message: "no", effect: "none", context, findings: [] },
];

function Page() {
  useKeeping();
  return <Questions />;
}

beforeEach(() => {
  sessionStorage.clear();
  editor().set({ workflowId: "" });
});

test("a draft that somebody else saved is told, though nothing was changed here", async () => {
  const mine = aWorkflow();
  const sent = serve((path) => [
    200,
    path.endsWith("/draft") ? { revision: 3 } : aWorkflow(THEIRS),
  ]);
  show(<Page />);
  editor().open(mine, "chemist");
  hearOf(aWorkflow(THEIRS));
  expect(await screen.findByTestId("draft-conflict")).toHaveTextContent(words.editor.conflict);
  await expect(saveSeen("note")).rejects.toThrow(words.editor.conflict);
  expect(sent).toHaveLength(0);
  await userEvent.click(screen.getByTestId("keep-mine"));
  await waitFor(() => expect(editor().saving.revision).toBe(3));
  expect(sent.at(-1)).toMatchObject({
    method: "PUT",
    body: { document: { name: "Mine" }, revision: 2 },
  });
});

test("theirs can be loaded, and is then what is saved", async () => {
  serve(() => [200, aWorkflow(THEIRS)]);
  show(<Page />);
  editor().open(aWorkflow(), "chemist");
  hearOf(aWorkflow(THEIRS));
  await userEvent.click(await screen.findByTestId("load-theirs"));
  await waitFor(() => expect(editor().history.document.name).toBe("Theirs"));
  expect(editor().saving).toMatchObject({ conflict: null, revision: 2 });
});

test("a version carries the revision that was seen, and its refusal is asked about", async () => {
  const sent = serve(() =>
    refused("workflow.revision", { revision: 2, document: named("Theirs") }),
  );
  editor().open(aWorkflow(), "chemist");
  await expect(saveSeen("note")).rejects.toThrow();
  expect(sent).toEqual([
    { method: "POST", path: "/api/v1/workflows/w1/versions", body: { note: "note", revision: 1 } },
  ]);
  expect(editor().saving.conflict).toBe(2);
});

test("an answer that was lost on its way is no other person's draft", () => {
  editor().open(aWorkflow(), "chemist");
  editor().edit(renameWorkflow("Mine, longer"));
  hearOf(aWorkflow({ draft: named("Mine, longer"), draft_revision: 2 }));
  expect(editor().saving).toMatchObject({ conflict: null, revision: 2 });
  expect(editor().saving.saved).toBe(editor().history.document);
});

test("who only looks is shown the newer draft at once", () => {
  editor().open(aWorkflow({ can_edit: false }), "observer");
  hearOf(aWorkflow({ ...THEIRS, can_edit: false }));
  expect(editor().history.document.name).toBe("Theirs");
  expect(editor().saving.conflict).toBeNull();
});

test("what was drawn outlives the end of the session, and is offered", async () => {
  serve(() => [401, { code: "http.not_authenticated", message: "sign in", findings: [] }]);
  const page = show(<Page />);
  editor().open(aWorkflow(), "chemist");
  editor().edit(renameWorkflow("Drawn"));
  await flushDraft();
  page.unmount();
  editor().set({ workflowId: "" });
  expect(keptOf("approver", "w1")).toBeNull();

  serve(() => [200, { revision: 2 }]);
  show(<Page />);
  editor().open(aWorkflow(), "chemist", keptOf("chemist", "w1"));
  expect(editor().history.document.name).toBe("Mine");
  await userEvent.click(await screen.findByTestId("offer-restore"));
  expect(editor().history.document.name).toBe("Drawn");
  expect(keptOf("chemist", "w1")).toMatchObject({ revision: 1, document: { name: "Drawn" } });
  expect(await flushDraft()).toBe(true);
  expect(keptOf("chemist", "w1")).toBeNull();
  editor().undo();
  expect(editor().history.document.name).toBe("Mine");
});

test("what is discarded is offered no more", () => {
  show(<Page />);
  editor().open(aWorkflow(), "chemist", { revision: 1, document: named("Drawn") });
  answerOffer(false);
  expect(editor().history.document.name).toBe("Mine");
  expect(keptOf("chemist", "w1")).toBeNull();
});

test("unsaved changes to an older revision are asked about as a conflict", async () => {
  show(<Page />);
  editor().open(aWorkflow(THEIRS), "chemist", { revision: 1, document: named("Drawn") });
  expect(await screen.findByTestId("draft-conflict")).toBeInTheDocument();
  expect(screen.queryByTestId("draft-offer")).toBeNull();
  expect(editor().history.document.name).toBe("Drawn");
  expect(keptOf("chemist", "w1")?.document.name).toBe("Drawn");
});

function aCheck(digest: string, note: string, proof: Proof | null = null): CheckResult {
  const plan = { digest, estimate_s: 1, steps: [], jobs: [], notes: [note], proved: null };
  return { findings: [], plan, policies: [], sentences: {}, proof };
}

const LOST = { version: 2, changes: [aFinding("volume of step s1 was 1 mL and is 2 mL")] };

test("the start sheet says that a draft is no longer proved, why, and what to do", async () => {
  const sent = serve((path) =>
    path === "/workflows/check" ? [200, aCheck("d1", "", LOST)] : [200, { user: null, lab: null }],
  );
  editor().open(aWorkflow(), "chemist");
  show(<RunSheet isOpen onClose={() => undefined} />);
  const told = await screen.findByTestId("proof-lost-sheet");
  expect(told).toHaveTextContent("No longer proved, as version 2 was.");
  expect(told).toHaveTextContent("Volume of step s1 was 1 mL and is 2 mL");
  expect(told).toHaveTextContent("open the recipe again");
  await waitFor(() => expect(screen.getByTestId("start-run")).toBeEnabled());
  const asked = sent.find((one) => one.path.endsWith("/check"));
  expect(asked?.body).toMatchObject({ workflow_id: "w1" });
});

test("the start sheet says what is proved, and what is not and why", async () => {
  const proved = { steps: ["s1", "s2"], beyond: [{ step_id: "s3", why: "it is not known" }] };
  const steps = [{ step_id: "s3", kind: "evaporate", sentence: "Evaporate Flask", estimate_s: 1 }];
  const result = aCheck("d1", "");
  serve((path) =>
    path === "/workflows/check"
      ? [200, { ...result, plan: { ...result.plan, steps, proved } }]
      : [200, { user: null, lab: null }],
  );
  editor().open(aWorkflow(), "chemist");
  show(<RunSheet isOpen onClose={() => undefined} />);
  const told = await screen.findByTestId("proved");
  expect(told).toHaveTextContent("Proved: 2 steps that move or change matter do what they ask for");
  expect(told).toHaveTextContent("Evaporate Flask: it is not known.");
});

test("the editor says so while one draws, and nothing while the proof holds", async () => {
  editor().open(aWorkflow(), "chemist");
  show(<Questions />);
  expect(screen.queryByTestId("proof-lost")).toBeNull();
  const checked = (proof: Proof | null): void =>
    act(() => editor().set({ checked: { content: "", result: aCheck("d1", "", proof), at: 0 } }));
  checked({ version: 2, changes: [] });
  expect(screen.queryByTestId("proof-lost")).toBeNull();
  checked({ ...LOST, changes: [...LOST.changes, aFinding("step s9 was put in")] });
  const told = screen.getByTestId("proof-lost");
  expect(told).toHaveTextContent("And one more change.");
  expect(screen.getByTestId("proof-open-recipe")).toHaveAttribute("href", "/workflows/xdl");
});

function aFinding(message: string): Finding {
  return { code: "recipe.proof_lost", message, subject: "s1", context: {} };
}

test("a run starts by the plan that was seen, and a changed plan is shown first", async () => {
  let check = aCheck("d1", "first plan");
  const sent = serve((path) => {
    if (path === "/workflows/check") return [200, check];
    if (path === "/workflows/w1") return [200, aWorkflow()];
    if (path === "/workflows/w1/versions") return [201, { id: "v1", number: 1 }];
    if (path === "/runs") return refused("run.plan_changed");
    return [200, { user: null, lab: null }];
  });
  editor().open(aWorkflow(), "chemist");
  show(<RunSheet isOpen onClose={() => undefined} />);
  await waitFor(() => expect(screen.getByTestId("start-run")).toBeEnabled());
  expect(screen.getByText("first plan")).toBeInTheDocument();
  check = aCheck("d2", "second plan");
  await userEvent.click(screen.getByTestId("start-run"));
  expect(await screen.findByText("second plan")).toBeInTheDocument();
  const starts = sent.filter((one) => one.path === "/api/v1/runs");
  expect(starts.map((one) => one.body)).toEqual([{ version_id: "v1", plan_digest: "d1" }]);
});

test("nothing is saved or started when somebody saved while the sheet was open", async () => {
  const sent = serve((path) => {
    if (path === "/workflows/check") return [200, aCheck("d1", "first plan")];
    if (path === "/workflows/w1") return [200, aWorkflow({ ...THEIRS, draft_revision: 9 })];
    return [200, { user: null, lab: null }];
  });
  editor().open(aWorkflow(), "chemist");
  show(<RunSheet isOpen onClose={() => undefined} />);
  await waitFor(() => expect(screen.getByTestId("start-run")).toBeEnabled());
  await userEvent.click(screen.getByTestId("start-run"));
  await waitFor(() => expect(editor().saving.conflict).toBe(9));
  await waitFor(() => expect(screen.getByTestId("start-run")).toBeDisabled());
  const written = sent.filter((one) => one.method !== "GET").map((one) => one.path);
  expect(written).toEqual(["/api/v1/workflows/check"]);
});

test("their draft that comes after another workflow was opened changes nothing of that one", async () => {
  let told: (answer: Response) => void = () => undefined;
  vi.stubGlobal("fetch", () => new Promise<Response>((resolve) => (told = resolve)));
  show(<Page />);
  act(() => editor().open(aWorkflow(), "ada"));
  act(() => editor().setSaving({ conflict: 2 }));
  await userEvent.click(screen.getByTestId("keep-mine"));
  act(() => editor().open(aWorkflow({ id: "w2", draft_revision: 7 }), "ada"));
  await act(async () => {
    told(new Response(JSON.stringify(aWorkflow(THEIRS))));
    await new Promise((wake) => setTimeout(wake, 20));
  });
  expect(editor()).toMatchObject({ workflowId: "w2", saving: { revision: 7 } });
});

test("their draft that cannot be had is told", async () => {
  serve(() => [500, { code: "http.500", message: "the server is ill", findings: [] }]);
  show(<Page />);
  act(() => editor().open(aWorkflow(), "ada"));
  act(() => editor().setSaving({ conflict: 2 }));
  await userEvent.click(screen.getByTestId("load-theirs"));
  await waitFor(() => expect(editor().saving.problem).toBe("The server is ill"));
  expect(screen.getByTestId("draft-conflict")).toBeInTheDocument();
});
