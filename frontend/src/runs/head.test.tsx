// @vitest-environment jsdom
import { fireEvent, screen } from "@testing-library/react";
import { expect, test, vi } from "vitest";
import { aJob, aRun, iso } from "@/model/samples";
import { serve, show } from "@/testpage";
import { RunHead } from "./head";

const can = { pause: true, resume: true, abort: true, resolve: true, recover: true, confirm: true };
const reasons = [
  { kind: "user", by: "Li Na", at: iso(1) },
  { kind: "user", by: "Wang Wei", at: iso(2) },
];
const paused = aRun([aJob(0, "a", "queued")], { state: "paused", pause_reasons: reasons, can });

test("a resume names the pauses that were seen, and a refusal is told", async () => {
  const refusal = { code: "run.paused_since", message: "Xu has paused it since", findings: [] };
  const sent = serve(() => [409, refusal]);
  show(<RunHead run={paused} />);
  fireEvent.click(screen.getByTestId("resume"));
  await vi.waitFor(() => expect(screen.getByRole("alert")).toHaveTextContent("Xu has paused"));
  expect(sent[0]?.body).toEqual({ pauses: [iso(1), iso(2)] });
});

test("who has not paused a paused run may pause it, too", () => {
  serve(() => [200, paused]);
  const view = show(<RunHead run={paused} />);
  expect(screen.getByTestId("pause")).toHaveTextContent("Pause, too");
  view.unmount();
  show(<RunHead run={{ ...paused, can: { ...can, pause: false } }} />);
  expect(screen.queryByTestId("pause")).toBeNull();
});

test("the reason of an abort stays until it is sent, and a doubt is named", () => {
  serve(() => [200, paused]);
  const run = { ...paused, in_doubt_count: 1 };
  const view = show(<RunHead run={run} />);
  fireEvent.click(screen.getByTestId("abort"));
  fireEvent.change(screen.getByTestId("abort-reason"), { target: { value: "wrong flask" } });
  expect(screen.getByText(/in doubt stays so/)).toBeInTheDocument();
  view.unmount();
  show(<RunHead run={run} />);
  fireEvent.click(screen.getByTestId("abort"));
  expect(screen.getByTestId("abort-reason")).toHaveValue("wrong flask");
});

test("an abort that was refused after its dialog was closed is told all the same", async () => {
  let answer: (response: Response) => void = () => undefined;
  vi.stubGlobal("fetch", () => new Promise<Response>((resolve) => (answer = resolve)));
  show(<RunHead run={paused} />);
  fireEvent.click(screen.getByTestId("abort"));
  fireEvent.change(screen.getByTestId("abort-reason"), { target: { value: "wrong flask" } });
  fireEvent.click(screen.getByTestId("abort-confirm"));
  await vi.waitFor(() => expect(screen.getByTestId("abort-confirm")).toBeDisabled());
  fireEvent.click(screen.getByText("Go on with the run"));
  const refusal = { code: "run.refused", message: "it was not aborted", findings: [] };
  answer(new Response(JSON.stringify(refusal), { status: 409 }));
  await vi.waitFor(() => expect(screen.queryByTestId("abort-reason")).toBeNull());
  await vi.waitFor(() => expect(screen.getByRole("alert")).toHaveTextContent("It was not aborted"));
});

test("the head says whether the plan is proved, and of what not and why", () => {
  serve(() => [200, paused]);
  const steps = [{ step_id: "e", kind: "evaporate", sentence: "Evaporate Flask", estimate_s: 1 }];
  const beyond = [{ step_id: "e", why: "it is not known" }];
  const plan = { ...paused.plan, steps };
  const first = show(<RunHead run={paused} />);
  expect(screen.queryByTestId("proved-chip")).toBeNull();
  first.unmount();
  const proved = { steps: ["a"], beyond: [] };
  const second = show(<RunHead run={{ ...paused, plan: { ...plan, proved } }} />);
  expect(screen.getByTestId("proved-chip")).toHaveTextContent("Plan proved");
  second.unmount();
  show(<RunHead run={{ ...paused, plan: { ...plan, proved: { steps: ["a"], beyond } } }} />);
  const chip = screen.getByTestId("proved-chip");
  expect(chip).toHaveTextContent("Plan proved in part");
  expect(chip).toHaveAttribute(
    "title",
    expect.stringContaining("Evaporate Flask: it is not known"),
  );
});
