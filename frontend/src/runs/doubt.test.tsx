// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aJob, aRun, iso } from "@/model/samples";
import type { Measured, Question } from "@/model/wire";
import { serve, show, type Sent } from "@/testpage";
import { DoubtCard } from "./doubt";

const question: Question = {
  text: "Was 5.00 mL moved from Water to Pump 1?",
  asked_ul: 5000,
  source: "Water",
  target: "Pump 1",
  attempt_id: "t0",
  measured: null,
  then: {
    did_not: [
      { name: "retry", why_not: null, consequence: "Sends the action again." },
      { name: "skip", why_not: null, consequence: "Leaves it undone." },
      { name: "done_by_hand", why_not: null, consequence: "Counts the job as done." },
    ],
    partly: [{ name: "retry", why_not: "a part has moved", consequence: "Sends it again." }],
    discard: [],
  },
  answer_sent: false,
  answered_by: null,
  answered_at: null,
};
const job = aJob(0, "a", "in_doubt", { started_at: iso(0), state_at: iso(12), question });
const run = aRun([job, aJob(1, "b", "queued", { after: [0] })]);

function card(change: Partial<typeof question> = {}, changed = run) {
  return <DoubtCard run={changed} job={job} question={{ ...question, ...change }} />;
}

/** What was written; the card reads what its device tells, too. */
const posted = (sent: Sent[]): Sent[] => sent.filter((one) => one.method === "POST");

const measured: Measured = {
  text: "The plunger stood at 10.000 mL before and stands at 6.500 mL now: 10.000 − 6.500 = 3.500 mL moved.",
  before_ul: 10_000,
  after_ul: 6500,
  moved_ul: 3500,
  tolerance_ul: 10,
  answer: "partly",
  contradicts: ["happened", "did_not"],
};

test("the answer is filled in from the readings, and the subtraction is shown", async () => {
  const sent = serve(() => [200, job]);
  show(card({ measured }));
  expect(screen.getByTestId("doubt-measured")).toHaveTextContent("10.000 − 6.500 = 3.500 mL moved");
  expect(screen.getByTestId("answer-partly")).toBeChecked();
  expect(screen.getByTestId("answer-amount")).toHaveValue("3.500");
  await userEvent.setup().type(screen.getByTestId("answer-note"), "read it, too{Enter}");
  expect(posted(sent)[0]?.body).toEqual({
    answer: "partly",
    moved_ul: 3500,
    note: "read it, too",
    attempt_id: "t0",
  });
});

test("nothing is filled in while a reading is missing, and the card says which", () => {
  serve(() => [200, {}]);
  const text = "Where the plunger stands now is missing: Pump 1 has not told it since.";
  show(card({ measured: { ...measured, text, moved_ul: null, answer: null, contradicts: [] } }));
  expect(screen.getByTestId("doubt-measured")).toHaveTextContent(text);
  expect(screen.getByTestId("answer-amount")).toHaveValue("");
  for (const radio of screen.getAllByRole("radio")) expect(radio).not.toBeChecked();
});

test("an answer that the readings contradict is sent only with a tick", async () => {
  const sent = serve(() => [200, job]);
  show(card({ measured }));
  const user = userEvent.setup();
  expect(screen.queryByTestId("answer-against")).toBeNull();
  await user.click(screen.getByTestId("answer-happened"));
  await user.type(screen.getByTestId("answer-note"), "the tube was full");
  expect(screen.getByTestId("answer-against")).toHaveTextContent("reads otherwise");
  expect(screen.getByTestId("answer-send")).toBeDisabled();
  await user.click(screen.getByTestId("answer-despite"));
  await user.click(screen.getByTestId("answer-send"));
  expect(posted(sent)[0]?.body).toMatchObject({ answer: "happened", despite_reading: true });
});

test("what follows is chosen in the same form, and a choice that is not offered says why", async () => {
  const sent = serve(() => [200, job]);
  show(card());
  const user = userEvent.setup();
  expect(screen.queryByTestId("doubt-then")).toBeNull();
  await user.click(screen.getByTestId("answer-partly"));
  expect(screen.getByTestId("then-retry")).toBeDisabled();
  expect(screen.getByText(/Try again: not now, a part has moved/)).toBeInTheDocument();
  await user.click(screen.getByTestId("answer-did_not"));
  await user.click(screen.getByTestId("then-done_by_hand"));
  await user.type(screen.getByTestId("answer-note"), "poured it");
  expect(screen.getByTestId("answer-send")).toBeDisabled();
  await user.type(screen.getByTestId("then-amount"), "5");
  await user.click(screen.getByTestId("answer-send"));
  expect(posted(sent)[0]?.body).toEqual({
    answer: "did_not",
    note: "poured it",
    attempt_id: "t0",
    then: "done_by_hand",
    then_moved_ul: 5000,
  });
});

test("there are four answers, each with its consequence, and no Retry", () => {
  serve(() => [200, {}]);
  show(card());
  expect(screen.getAllByRole("radio")).toHaveLength(4);
  expect(screen.getByText("commits 5.00 mL")).toBeInTheDocument();
  expect(screen.getByText("both stay quarantined")).toBeInTheDocument();
  expect(screen.queryByText(/retry/i)).toBeNull();
});

test("nothing can be sent before an answer and a note are given", async () => {
  const sent = serve(() => [200, {}]);
  show(card());
  const user = userEvent.setup();
  expect(screen.getByTestId("answer-send")).toBeDisabled();
  await user.click(screen.getByTestId("answer-happened"));
  expect(screen.getByTestId("answer-send")).toBeDisabled();
  await user.type(screen.getByTestId("answer-note"), "level seen");
  expect(screen.getByTestId("answer-send")).toBeEnabled();
  expect(posted(sent)).toHaveLength(0);
});

test("partly sends the amount in microlitres", async () => {
  const sent = serve(() => [200, job]);
  show(card());
  const user = userEvent.setup();
  await user.type(screen.getByTestId("answer-amount"), "3.2");
  await user.type(screen.getByTestId("answer-note"), "read the scale");
  const button = screen.getByTestId("answer-send");
  expect(button).toHaveTextContent("Commit 3.20 mL");
  await user.click(button);
  expect(posted(sent)[0]).toEqual({
    method: "POST",
    path: "/api/v1/jobs/j0/resolve",
    body: { answer: "partly", moved_ul: 3200, note: "read the scale", attempt_id: "t0" },
  });
});

test.each(["5", "0", "7 mL", "2,5"])("an amount of %s is refused with a reason", async (text) => {
  serve(() => [200, job]);
  show(card());
  const user = userEvent.setup();
  await user.type(screen.getByTestId("answer-amount"), text);
  await user.type(screen.getByTestId("answer-note"), "seen");
  expect(screen.getByTestId("answer-send")).toBeDisabled();
  expect(screen.getByText(/Must be|decimal point/)).toBeInTheDocument();
});

test("an answer that is under way is not asked again", () => {
  serve(() => [200, {}]);
  show(card({ answer_sent: true, answered_by: "Wang Wei", answered_at: iso(30) }));
  expect(screen.getByTestId("answer-sent")).toHaveTextContent(/^Wang Wei has answered/);
  expect(screen.queryByRole("radio")).toBeNull();
});

test("a refusal is shown in the card with its code", async () => {
  const refusal = { code: "run.answered", message: "An answer is under way.", findings: [] };
  serve(() => [409, refusal]);
  show(card());
  const user = userEvent.setup();
  await user.click(screen.getByTestId("answer-did_not"));
  await user.type(screen.getByTestId("answer-note"), "nothing in the tube");
  await user.click(screen.getByTestId("answer-send"));
  expect(await screen.findByText("run.answered")).toBeInTheDocument();
});

test("who may not resolve sees why", () => {
  serve(() => [200, {}]);
  show(card({}, { ...run, can: { ...run.can, resolve: false } }));
  expect(screen.getByTestId("answer-send")).toBeDisabled();
});

test.each([
  ["happened", "Step 2 can then start."],
  ["did_not", "Step 2 will not start. The run then waits for you."],
  ["discard", "Step 2 will not start. The run then waits for you."],
])("the answer %s says what becomes of the steps behind it", async (kind, text) => {
  serve(() => [200, {}]);
  show(card());
  await userEvent.setup().click(screen.getByTestId(`answer-${kind}`));
  expect(screen.getByText(text)).toBeInTheDocument();
});

test("the last action that did not happen ends its run", async () => {
  serve(() => [200, {}]);
  show(card({}, aRun([job])));
  await userEvent.setup().click(screen.getByTestId("answer-did_not"));
  expect(screen.getByText("The run then waits for you.")).toBeInTheDocument();
});

test("an action in doubt says what could tell how far it came", () => {
  show(<DoubtCard run={run} job={{ ...job, recovery_class: "R2" }} question={question} />);
  expect(screen.getByTestId("doubt-class")).toHaveTextContent(/A measurement tells/);
});

test("an answer that is being written stays when the page is left", async () => {
  serve(() => [200, {}]);
  const first = show(card());
  const user = userEvent.setup();
  await user.type(screen.getByTestId("answer-amount"), "2.74");
  await user.type(screen.getByTestId("answer-note"), "read the plunger");
  first.unmount();
  show(card());
  expect(screen.getByTestId("answer-partly")).toBeChecked();
  expect(screen.getByTestId("answer-amount")).toHaveValue("2.74");
  expect(screen.getByTestId("answer-note")).toHaveValue("read the plunger");
});

test("what was seen of one doubt is not offered for the next of the same action", async () => {
  serve(() => [200, {}]);
  const page = show(card());
  await userEvent.click(screen.getByTestId("answer-happened"));
  await userEvent.type(screen.getByTestId("answer-note"), "tube is full");
  const again = { ...job, state_at: iso(60) };
  page.rerender(<DoubtCard run={aRun([again])} job={again} question={question} />);
  expect(screen.getByTestId("answer-note")).toHaveValue("");
  expect(screen.getByTestId("answer-happened")).not.toBeChecked();
  page.rerender(card());
  expect(screen.getByTestId("answer-note")).toHaveValue("tube is full");
});
