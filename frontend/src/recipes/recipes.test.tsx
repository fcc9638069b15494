// @vitest-environment jsdom
import { screen, waitFor, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test, vi } from "vitest";
import { useOpened } from "@/api/opened";
import { aCheck, anOpening, aPlan, aPlannedStep } from "@/model/recipesamples";
import type { Opening, RecipeAdvice } from "@/model/wirerecipe";
import { serve, show, type Sent } from "@/testpage";
import { RecipePage } from "./page";

const user = {
  username: "chemist",
  permissions: ["view", "draw"],
  lab_permissions: ["view", "draw"],
};
const TEXT = "<XDL>\n  <Add reagent='water'/>\n</XDL>";
const recipe = (): File => new File([TEXT], "warm.xdl");
const refused: Partial<Opening> = {
  plan: null,
  is_proved: null,
  findings: [
    {
      code: "plan.no_reagent",
      message: "no flask holds 'water'",
      subject: "line 2, column 3",
      context: { line: 2, column: 3 },
      about: "rig",
    },
  ],
};
let check = aCheck();
const advice: RecipeAdvice = {
  ok: true,
  changes: [{ change: "add_flask", text: "Add a flask of water", adds: ["flask_water"] }],
  graph_sha256: "ef",
  graph: "{}",
};

function page(answer: (body: Record<string, unknown>) => Opening): Sent[] {
  const sent: Sent[] = serve((path) => {
    const body = (sent[sent.length - 1]?.body ?? {}) as Record<string, unknown>;
    if (path === "/session") return [200, { user, lab: null }];
    if (path === "/recipes/open") return [200, answer(body)];
    if (path === "/recipes/advise") return [200, advice];
    if (path === "/workflows/check") return [200, check];
    return [201, { workflow_id: "w", version: { id: "v", number: 1 } }];
  });
  show(<RecipePage />, "/workflows/xdl");
  return sent;
}

/** What was sent last to open a recipe. */
const opened = (sent: Sent[]): unknown =>
  sent.findLast((one) => one.path.endsWith("/recipes/open"))?.body;

beforeEach(() => {
  check = aCheck();
  useOpened.getState().close();
  vi.stubGlobal(
    "URL",
    Object.assign(URL, { createObjectURL: () => "blob:x", revokeObjectURL: () => undefined }),
  );
});

test("without a recipe the page says what it is for, and takes one", async () => {
  page(() => anOpening());
  expect(screen.getByTestId("empty")).toHaveTextContent("No recipe is open");
  await userEvent.upload(await screen.findByTestId("open-xdl-input"), recipe(), {
    applyAccept: false,
  });
  expect(await screen.findByTestId("recipe-steps")).toBeInTheDocument();
  expect(screen.getByTestId("proof")).toHaveAttribute("data-state", "proved");
  await waitFor(() =>
    expect(screen.getByTestId("start-now")).toHaveAttribute("data-state", "starts"),
  );
});

test("a step shows its route and unfolds to its actions, those at the same time side by side", async () => {
  await useOpened.getState().openRecipe(recipe());
  page(() => anOpening());
  const [first] = await screen.findAllByTestId("planned-step");
  await userEvent.click(within(first as HTMLElement).getByText(/Move/));
  expect(await screen.findAllByTestId("route-tube")).toHaveLength(2);
  await userEvent.click(within(first as HTMLElement).getByLabelText("3 actions of step 1"));
  const groups = within(first as HTMLElement).getByTestId("actions").children;
  expect([...groups].map((group) => group.getAttribute("data-count"))).toEqual(["2", "1"]);
  expect(screen.getByTestId("recipe-text").querySelector("[aria-current]")).toHaveAttribute(
    "data-line",
    "2",
  );
});

test("what is not proved is no plan, and its findings lead to their lines", async () => {
  await useOpened.getState().openRecipe(recipe());
  page(() => anOpening(refused));
  await userEvent.click(await screen.findByRole("button", { name: "Line 2, 3" }));
  const line = screen.getByTestId("recipe-text").querySelector('[data-line="2"]');
  await waitFor(() => expect(line).toHaveFocus());
  expect(line).toHaveAttribute("aria-current", "true");
  expect(screen.queryByTestId("recipe-steps")).toBeNull();
  expect(screen.getByTestId("save-recipe")).toBeDisabled();
});

test("a recipe that would not start now says at which step and why", async () => {
  await useOpened.getState().openRecipe(recipe());
  check = aCheck({
    plan: null,
    findings: [
      {
        code: "driver.argument_range",
        message: "chiller: temperature_c is at most 110 °C; got 130",
        subject: "s4",
        context: {},
      },
    ],
    sentences: { s4: [{ text: "Bring the reactor to 130 °C", strong: false, sort: "" }] },
  });
  const sent = page(() => anOpening());
  const finding = await screen.findByTestId("start-finding");
  expect(screen.getByTestId("start-now")).toHaveTextContent("Cannot start");
  expect(finding).toHaveTextContent("Bring the reactor to 130 °C");
  expect(finding).toHaveTextContent("at most 110 °C");
  const asked = sent.find((one) => one.path.endsWith("/workflows/check"));
  expect(asked?.body).toMatchObject({ document: anOpening().document, workflow_id: null });
});

test("a recipe that becomes no workflow cannot be saved", async () => {
  await useOpened.getState().openRecipe(recipe());
  page(() => anOpening({ document: null }));
  expect(await screen.findByTestId("save-recipe")).toBeDisabled();
  expect(screen.queryByTestId("start-now")).toBeNull();
});

test("a vessel chosen by hand is asked for, and what was chosen stays chosen meanwhile", async () => {
  await useOpened.getState().openRecipe(recipe());
  const sent = page(() => anOpening());
  await userEvent.selectOptions(await screen.findByLabelText("water is"), "other");
  await waitFor(() =>
    expect(sent.filter((one) => one.path.endsWith("/recipes/open"))).toHaveLength(2),
  );
  expect(opened(sent)).toMatchObject({ bind: { water: "other" }, graph: null });
  expect(screen.getByLabelText("water is")).toHaveValue("other");
});

test("another rig is compared with the one before, step by step", async () => {
  await useOpened.getState().openRecipe(recipe());
  page((body) =>
    body.graph === null
      ? anOpening()
      : anOpening({ plan: aPlan([aPlannedStep({ estimate_s: 30 })]) }),
  );
  await screen.findByTestId("recipe-steps");
  await userEvent.upload(screen.getByTestId("add-graph-input"), new File(["{}"], "wheel.json"));
  const counts = await screen.findByTestId("difference-counts");
  expect(counts).toHaveTextContent("0 added, 1 left out, 0 changed, 1 done otherwise");
  const [steps] = screen.getAllByTestId("difference-row");
  expect(steps).toHaveTextContent("Steps21");
});

test("a refused recipe gets advice, and the corrected graph is tried at once", async () => {
  await useOpened.getState().openRecipe(recipe());
  const sent = page((body) => anOpening(body.graph === null ? refused : {}));
  await userEvent.click(await screen.findByTestId("ask-advice"));
  expect(await screen.findByTestId("advised-change")).toHaveTextContent("Add a flask of water");
  expect(screen.getByTestId("corrected-graph")).toHaveAttribute("download", "warm-corrected.json");
  await userEvent.click(screen.getByTestId("try-corrected"));
  expect(await screen.findByTestId("recipe-steps")).toBeInTheDocument();
  expect(opened(sent)).toMatchObject({ graph: btoa("{}") });
});

test("it is saved with the keys of the lab, under a name", async () => {
  await useOpened.getState().openRecipe(recipe());
  const sent = page(() => anOpening());
  await screen.findByTestId("recipe-steps");
  await userEvent.click(screen.getByTestId("save-recipe"));
  await userEvent.click(await screen.findByTestId("save-confirm"));
  await waitFor(() => expect(sent.some((one) => one.path.endsWith("/recipes/keep"))).toBe(true));
  const kept = sent.find((one) => one.path.endsWith("/recipes/keep"));
  expect(kept?.body).toMatchObject({ name: "warm", file: "warm.xdl", bind: { water: "flask" } });
});

test("a file that is too large is refused before it is sent", async () => {
  await useOpened.getState().openRecipe(new File(["x".repeat(1_500_000)], "huge.xdl"));
  const sent = page(() => anOpening());
  expect(screen.getByTestId("file-problem")).toHaveTextContent("at most 1.4 MB");
  expect(sent.some((one) => one.path.endsWith("/recipes/open"))).toBe(false);
});
