// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aJob, aRun, iso } from "@/model/samples";
import type { Question } from "@/model/wire";
import { serve, show, type Sent } from "@/testpage";
import { DoubtCard } from "./doubt";

const question: Question = {
  text: "Was 5.00 mL moved from Water to Pump 1?",
  asked_ul: 5000,
  source: "Water",
  target: "Pump 1",
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
    body: { answer: "partly", moved_ul: 3200, note: "read the scale" },
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
