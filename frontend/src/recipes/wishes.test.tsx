// @vitest-environment jsdom
import { screen, waitFor, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test } from "vitest";
import { useOpened } from "@/api/opened";
import { aCheck, anOpening } from "@/model/recipesamples";
import type { Opening, RecipeFinding, RecipeParameter } from "@/model/wirerecipe";
import { serve, show, type Sent } from "@/testpage";
import { RecipePage } from "./page";

const user = {
  username: "chemist",
  permissions: ["view", "draw"],
  lab_permissions: ["view", "draw"],
};
const dose: RecipeParameter = {
  id: "dose",
  sort: "volume",
  unit: "mL",
  value: "",
  least: "1 mL",
  most: "20 mL",
};

function opening(told: Partial<Opening> = {}, recipe: object = {}): Opening {
  const plain = anOpening(told);
  return { ...plain, recipe: plain.recipe && { ...plain.recipe, ...recipe } };
}

const wish = (context: object): RecipeFinding => ({
  code: "unit.vague",
  message: "'two drops' says no amount",
  subject: "",
  context: context as Record<string, unknown>,
  about: "wish",
});

function page(answer: (body: Record<string, unknown>) => Opening): Sent[] {
  const sent: Sent[] = serve((path) => {
    const body = (sent[sent.length - 1]?.body ?? {}) as Record<string, unknown>;
    if (path === "/session") return [200, { user, lab: null }];
    if (path === "/workflows/check") return [200, aCheck()];
    if (path === "/recipes/keep") return [201, { workflow_id: "w", version: { id: "v" } }];
    return [200, answer(body)];
  });
  show(<RecipePage />, "/workflows/xdl");
  return sent;
}

const asked = (sent: Sent[]): unknown =>
  sent.filter((one) => one.path.endsWith("/recipes/open")).at(-1)?.body;

beforeEach(async () => {
  useOpened.getState().close();
  await useOpened.getState().openRecipe(new File(["<XDL/>"], "warm.xdl"));
});

test("a parameter is asked for with unit and limits, and what is wrong stands at it", async () => {
  const sent = page((body) => {
    const given = (body.parameters as Record<string, string>).dose;
    const findings = given === "two drops" ? [wish({ parameter: "dose" })] : [];
    return opening({ findings }, { parameters: [dose] });
  });
  const field = await screen.findByLabelText("dose, in mL");
  expect(screen.getByText("1 mL to 20 mL; has no value yet.")).toBeInTheDocument();
  expect(screen.getByTestId("say-wishes")).toBeDisabled();
  await userEvent.type(field, "two drops");
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() => expect(field).toHaveAttribute("aria-invalid", "true"));
  expect(asked(sent)).toMatchObject({ parameters: { dose: "two drops" } });
  await userEvent.click(screen.getByTestId("give-value"));
  expect(field).toHaveFocus();
  await userEvent.clear(field);
  await userEvent.type(field, "5 mL{Enter}");
  await waitFor(() => expect(asked(sent)).toMatchObject({ parameters: { dose: "5 mL" } }));
  await waitFor(() => expect(field).not.toHaveAttribute("aria-invalid"));
  await userEvent.click(await screen.findByTestId("save-recipe"));
  await userEvent.click(await screen.findByTestId("save-confirm"));
  await waitFor(() => expect(sent.at(-1)?.body).toMatchObject({ parameters: { dose: "5 mL" } }));
});

test("what is in vessels already is said row by row, and half a row is told", async () => {
  const sent = page((body) => {
    const held = (body.holds as Record<string, Record<string, string>>).flask;
    const isBad = held?.water === "20";
    return opening({ findings: isBad ? [wish({ vessel: "flask", reagent: "water" })] : [] });
  });
  await userEvent.click(await screen.findByText("In vessels already"));
  await userEvent.click(screen.getByTestId("add-held"));
  expect(screen.getByTestId("say-wishes")).toBeDisabled();
  await userEvent.selectOptions(screen.getByTestId("held-vessel"), "flask");
  await userEvent.type(screen.getByTestId("held-reagent"), "water");
  await userEvent.type(screen.getByTestId("held-volume"), "20");
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() =>
    expect(screen.getByTestId("held-volume")).toHaveAttribute("aria-invalid", "true"),
  );
  expect(asked(sent)).toMatchObject({ holds: { flask: { water: "20" } } });
  await userEvent.click(within(screen.getByTestId("held")).getByLabelText("Remove"));
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ holds: {} }));
});

test("rinses are taken in the order in which they are chosen", async () => {
  const sent = page(() => opening({}, { cleans_with: ["ether"] }));
  await userEvent.click(await screen.findByText("Rinse the lines with"));
  expect(screen.getByText(/As the recipe says: ether\./)).toBeInTheDocument();
  await userEvent.selectOptions(screen.getByTestId("add-rinse"), "water");
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ rinse: ["water"] }));
});

test("tubes are filled when that is asked for, also in what is saved, and not before", async () => {
  const sent = page(() => opening());
  const tick = await screen.findByLabelText("Fill tubes before, push them out after");
  expect(tick).not.toBeChecked();
  await waitFor(() => expect(asked(sent)).toMatchObject({ primes: false }));
  await userEvent.click(tick);
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ primes: true }));
  expect(screen.getByTestId("say-wishes")).toBeDisabled();
  await userEvent.click(await screen.findByTestId("save-recipe"));
  await userEvent.click(await screen.findByTestId("save-confirm"));
  await waitFor(() => expect(sent.at(-1)?.body).toMatchObject({ primes: true }));
});

test("a file with blueprints goes with the recipe, and away again", async () => {
  const findings: RecipeFinding[] = [{ ...wish({ line: 4 }), code: "xdl.unknown_step" }];
  const sent = page((body) =>
    opening((body.blueprints as string[]).length ? {} : { findings, plan: null }),
  );
  expect(await screen.findByTestId("wish-blueprints")).toHaveAttribute("open");
  await userEvent.upload(screen.getByTestId("add-blueprints-input"), new File(["<B/>"], "b.xdl"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ blueprints: [btoa("<B/>")] }));
  await userEvent.click(await screen.findByLabelText("Remove b.xdl"));
  await waitFor(() => expect(useOpened.getState().blueprints).toEqual([]));
});

test("equivalents are asked for when the recipe counts by them", async () => {
  const findings = [{ ...wish({ line: 4 }), code: "xdl.no_equivalents" }];
  const sent = page((body) => opening(body.equiv_amount ? {} : { findings }));
  await userEvent.selectOptions(await screen.findByTestId("equiv-reference"), "water");
  await userEvent.type(screen.getByTestId("equiv-amount"), "1 g");
  await userEvent.click(screen.getByTestId("say-wishes"));
  await waitFor(() =>
    expect(asked(sent)).toMatchObject({ equiv_reference: "water", equiv_amount: "1 g" }),
  );
});

test("a reagent in two flasks lists both, and is saved once one is chosen", async () => {
  const [row] = anOpening().bindings;
  page((body) => {
    const chosen = (body.bind as Record<string, string>).water;
    const keys = chosen ? [chosen] : ["flask", "other"];
    return opening({ bindings: row ? [{ ...row, keys }] : [] });
  });
  expect(await screen.findByTestId("several")).toHaveTextContent("In flask and other");
  expect(screen.getByTestId("save-recipe")).toBeDisabled();
  await userEvent.selectOptions(screen.getByLabelText("water is"), "other");
  await waitFor(() => expect(screen.queryByTestId("several")).toBeNull());
  expect(screen.getByTestId("save-recipe")).toBeEnabled();
});

test("a flask whose label looks like the reagent is taken by one press alone", async () => {
  const [row] = anOpening().bindings;
  const sent = page((body) => {
    const chosen = (body.bind as Record<string, string>).water;
    const told = chosen ? { keys: [chosen] } : { keys: [], alike: ["flask"] };
    return opening({ bindings: row ? [{ ...row, ...told }] : [] });
  });
  await userEvent.click(await screen.findByTestId("take-alike"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ bind: { water: "flask" } }));
  expect(screen.queryByTestId("take-alike")).toBeNull();
});

test("what is stated beside the recipe goes with it, is saved with it, and tells what is wrong", async () => {
  const wrong: RecipeFinding = {
    code: "xdl.not_declared",
    message: "'brime' is stated among the keys; the recipe says it nowhere",
    subject: "",
    context: { at: "keys" },
    about: "declared",
  };
  const sent = page((body) =>
    opening(body.declared === btoa("{bad}") ? { findings: [wrong], plan: null } : {}),
  );
  const field = await screen.findByTestId("add-declared-input");
  await userEvent.upload(field, new File(["{bad}"], "bad.json"));
  expect(await screen.findByTestId("recipe-finding")).toHaveTextContent("Stated beside it, keys");
  expect(within(screen.getByTestId("wish-declared")).getByRole("alert")).toHaveTextContent("brime");
  await userEvent.upload(screen.getByTestId("add-declared-input"), new File(["{}"], "good.json"));
  await waitFor(() => expect(asked(sent)).toMatchObject({ declared: btoa("{}") }));
  await waitFor(() => expect(screen.getByTestId("save-recipe")).toBeEnabled());
  await userEvent.click(screen.getByTestId("save-recipe"));
  await userEvent.click(await screen.findByTestId("save-confirm"));
  await waitFor(() =>
    expect(sent.at(-1)?.body).toMatchObject({ declared: btoa("{}"), holds: {}, rinse: [] }),
  );
  await userEvent.click(screen.getByLabelText("Remove good.json"));
  expect(useOpened.getState().declared).toBeNull();
});
