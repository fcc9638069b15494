// @vitest-environment jsdom
import { fireEvent, screen, waitFor } from "@testing-library/react";
import { expect, test } from "vitest";
import { aJob, aRun, iso } from "@/model/samples";
import { serve, show } from "@/testpage";
import { Problems } from "./problem";

const paused = (kind: string) =>
  aRun([aJob(0, "a", "queued")], {
    state: "paused",
    pause_reasons: [{ kind, by: "Li Na", at: iso(1) }],
  });

const recovery = {
  recovery: "R1",
  tries: 1,
  choices: [
    { name: "retry" as const, why_not: null, consequence: "Sends the action again." },
    { name: "skip" as const, why_not: null, consequence: "Leaves the device as it is." },
  ],
  skips: [],
  relying: [],
  asked_ul: null,
  moved_ul: null,
  params: {},
};

test("a step that a stop of the lab undid is asked about, and says what was taken away", () => {
  serve(() => [200, { devices: [] }]);
  const job = aJob(0, "a", "complete", { halted_by: "edge.stopped", recovery });
  const view = show(<Problems run={{ ...paused("stopped"), jobs: [job] }} job={null} />);
  expect(screen.getByText("Lab stopped by Li Na")).toBeInTheDocument();
  expect(screen.getByTestId("problem-effect")).toHaveTextContent(
    /was halted with the whole lab, and what it had set is unknown/,
  );
  expect(screen.getAllByRole("radio")).toHaveLength(3);
  view.unmount();
  const letGo = { ...job, halted_by: "let_go", recovery: null };
  show(<Problems run={{ ...paused("stopped"), jobs: [letGo] }} job={null} />);
  expect(screen.queryByTestId("problem-card")).toBeNull();
});

test("a step whose set-point is gone says what its device reads, and is asked about", () => {
  serve(() => [200, { devices: [] }]);
  const message =
    "the speed set-point reads 0 rpm; 400 rpm was set: the device has restarted, or somebody has changed it";
  const change = { halted_by: "edge.setpoint_lost", message, recovery };
  const job = aJob(0, "a", "complete", change);
  show(<Problems run={{ ...paused("lost"), jobs: [job] }} job={null} />);
  expect(screen.getByText("Its device does not keep it")).toBeInTheDocument();
  expect(screen.getByText(/A device does not keep what a step had set/)).toBeInTheDocument();
  const text = screen.getByTestId("problem-effect");
  expect(text).toHaveTextContent(/does not keep what was set/);
  expect(text).toHaveTextContent(/reads 0 rpm; 400 rpm was set/);
  expect(screen.getAllByRole("radio")).toHaveLength(3);
});

test("what a halt makes of a foreign node's goal is said to be known to its maker alone", () => {
  serve(() => [200, { devices: [] }]);
  const change = { halted_by: "edge.halted", is_halt_certain: false, recovery };
  const job = aJob(0, "a", "complete", change);
  show(<Problems run={{ ...paused("halted"), jobs: [job] }} job={null} />);
  expect(screen.getByText("May be undone by a halt")).toBeInTheDocument();
  expect(screen.getByTestId("problem-effect")).toHaveTextContent(/it may be off, or go on/);
});

test.each([
  ["stale", false, /It does not answer its host/],
  ["online", true, /Its host has to halt it first/],
] as const)("what waits at its host says why: %s, a halt owed %s", async (link, owed, text) => {
  const job = aJob(0, "a", "accepted");
  const device = { id: job.device.id, name: "Pump 1", link, is_halt_owed: owed, readings: [] };
  serve(() => [200, { devices: [device] }]);
  show(<Problems run={aRun([job])} job={null} />);
  expect(await screen.findByTestId("waits-card")).toHaveTextContent(text);
});

test("a device of which what stands is not read is named, with what was set on it", () => {
  serve(() => [200, { devices: [] }]);
  const device = { id: "d1", name: "Hotplate 1" };
  const one = { device, since_at: "2026-01-01T10:00:00Z", sentences: ["Heat to 60 °C"] };
  const view = show(<Problems run={aRun([], { silent: [one] })} job={null} />);
  const card = screen.getByTestId("silent-card");
  expect(card).toHaveTextContent(/Hotplate 1 has not been read since/);
  expect(card).toHaveTextContent("Heat to 60 °C");
  expect(screen.getByRole("link", { name: "Open Hotplate 1" })).toHaveAttribute(
    "href",
    "/devices/d1",
  );
  view.unmount();
  show(<Problems run={aRun([])} job={null} />);
  expect(screen.queryByTestId("silent-card")).toBeNull();
});

test("an answer that its device reads otherwise since says both and leads to the amounts", () => {
  serve(() => [200, { devices: [] }]);
  const text = "Pump 1 reads otherwise than Li Na answered: Li Na answered that 5 mL moved";
  const one = { ticket_id: "t1", text, opened_at: "2026-01-01T10:00:00Z" };
  show(<Problems run={aRun([], { contradicted: [one] })} job={null} />);
  const card = screen.getByTestId("contradicted-card");
  expect(card).toHaveTextContent("Pump 1 reads otherwise than Li Na answered");
  expect(card).toHaveTextContent("Li Na answered that 5 mL moved.");
  expect(screen.getByRole("link", { name: "Correct amounts…" })).toHaveAttribute(
    "href",
    "/lab?ticket=t1",
  );
});

test("what a device that answers was sent does not wait for it", async () => {
  const job = aJob(0, "a", "accepted");
  const device = { id: job.device.id, name: "Pump 1", link: "online", is_halt_owed: false };
  const sent = serve(() => [200, { devices: [device] }]);
  show(<Problems run={aRun([job])} job={null} />);
  await waitFor(() => expect(sent).not.toHaveLength(0));
  expect(screen.queryByTestId("waits-card")).toBeNull();
});

test("a failure says how much moved of what was asked for", () => {
  serve(() => [200, { devices: [] }]);
  const recovery = {
    recovery: "R2",
    tries: 1,
    choices: [],
    skips: [],
    relying: [],
    asked_ul: 5000,
    moved_ul: 2740,
    params: {},
  };
  const transaction = { id: "t", state: "committed" };
  const job = aJob(0, "a", "aborted", { transaction, recovery });
  show(<Problems run={aRun([job], { state: "paused" })} job={null} />);
  const effect = screen.getByTestId("problem-effect");
  expect(effect).toHaveTextContent("2.74 mL of 5.00 mL moved, by the record.");
});

test("an action that was given up is not told as one that did nothing", () => {
  serve(() => [200, { devices: [] }]);
  const transaction = { id: "t", state: "rolled_back" };
  const resolution = { answer: "discard", note: "nobody saw it" };
  const job = aJob(0, "a", "aborted", { transaction, recovery, evidence: { resolution } });
  const view = show(<Problems run={aRun([job], { state: "paused" })} job={null} />);
  expect(screen.getByTestId("problem-effect")).toHaveTextContent(/^Nobody knows what it did/);
  view.unmount();
  const told = { ...job, evidence: { resolution: { ...resolution, answer: "did_not" } } };
  show(<Problems run={aRun([told], { state: "paused" })} job={null} />);
  expect(screen.getByTestId("problem-effect")).toHaveTextContent(/^Nothing moved/);
});

test("a run that waits for a person says what to confirm, and says so to the server once", async () => {
  const asks = {
    text: "Is the stopcock closed?",
    states: null,
    is_due: true,
    confirmed_by: null,
    confirmed_at: null,
  };
  const job = aJob(0, "a", "queued", { asks });
  const run = aRun([job], { state: "running" });
  const sent = serve((_path, method) => {
    if (method !== "POST") return [200, { devices: [] }];
    return [200, { ...run, jobs: [{ ...job, asks: { ...asks, is_due: false } }] }];
  });
  show(<Problems run={run} job={null} />);
  expect(screen.getByTestId("asks-card")).toHaveTextContent("Is the stopcock closed?");
  screen.getByTestId("asks-confirm").click();
  const posted = () => sent.filter((one) => one.method === "POST");
  await waitFor(() => expect(posted()).toHaveLength(1));
  expect(posted()[0]?.path).toContain(`/jobs/${job.id}/confirm`);
  await waitFor(() => expect(screen.getByTestId("asks-confirm")).toBeEnabled());
});

test("amounts of lots are stated in the place of a job; what is left empty is not sent", async () => {
  const lots = [
    { key: "brine-1", name: "Brine", held_ul: 10_000, held_mg: null },
    { key: "ether-1", name: "Ether", held_ul: 20_000, held_mg: null },
  ];
  const asks = {
    text: "Which lots lie in the lower layer of Separator?",
    states: { label: "Lower layer", leaves_out: true, lots },
    is_due: true,
    confirmed_by: null,
    confirmed_at: null,
  };
  const job = aJob(0, "a", "queued", { asks });
  const run = aRun([job], { state: "running" });
  const refusal = { code: "crutd.insufficient_volume", message: "Separator holds 10 mL" };
  const sent = serve((_path, method) => (method === "POST" ? [409, refusal] : [200, run]));
  show(<Problems run={run} job={null} />);
  expect(screen.queryByTestId("asks-confirm")).toBeNull();
  expect(screen.getByTestId("asks-state")).toBeDisabled();
  expect(screen.getAllByTestId("asks-lot")[1]).toHaveTextContent("Ether ether-1");
  fireEvent.click(screen.getAllByText("All")[0] as HTMLElement);
  fireEvent.change(screen.getByTestId("asks-amount-ether-1"), { target: { value: "  " } });
  fireEvent.click(screen.getByTestId("asks-state"));
  const posted = () => sent.filter((one) => one.method === "POST");
  await waitFor(() => expect(posted()).toHaveLength(1));
  expect(posted()[0]?.body).toEqual({ stated: { "brine-1": "all" } });
  await waitFor(() => expect(screen.getByTestId("refused")).toBeVisible());
  expect(screen.getByTestId("asks-amount-brine-1")).toHaveValue("all");
  fireEvent.click(screen.getByTestId("asks-none"));
  await waitFor(() => expect(posted()).toHaveLength(2));
  expect(posted()[1]?.body).toEqual({ stated: {} });
});

test("of solids each is stated: what is left empty goes as none", async () => {
  const lots = [
    { key: "salt-1", name: "Salt", held_ul: null, held_mg: 500 },
    { key: "sand-1", name: "Sand", held_ul: null, held_mg: 20 },
  ];
  const states = { label: "Solids that go along", leaves_out: false, lots };
  const asks = { text: "How?", states, is_due: true, confirmed_by: null, confirmed_at: null };
  const run = aRun([aJob(0, "a", "queued", { asks })], { state: "running" });
  const sent = serve(() => [200, run]);
  show(<Problems run={run} job={null} />);
  expect(screen.getAllByTestId("asks-lot")[0]).toHaveTextContent(/500\.00\smg in the vessel/);
  fireEvent.change(screen.getByTestId("asks-amount-salt-1"), { target: { value: "200 mg" } });
  fireEvent.click(screen.getByTestId("asks-state"));
  const posted = () => sent.filter((one) => one.method === "POST");
  await waitFor(() => expect(posted()).toHaveLength(1));
  expect(posted()[0]?.body).toEqual({ stated: { "salt-1": "200 mg", "sand-1": "none" } });
  await waitFor(() => expect(screen.getByTestId("asks-none")).toBeEnabled());
  fireEvent.click(screen.getByText("None of any solid"));
  await waitFor(() => expect(posted()).toHaveLength(2));
  expect(posted()[1]?.body).toEqual({ stated: { "salt-1": "none", "sand-1": "none" } });
});

test("where no solid is left the run goes on without one", async () => {
  const states = { label: "Stays", leaves_out: false, lots: [] };
  const asks = { text: "How?", states, is_due: true, confirmed_by: null, confirmed_at: null };
  const run = aRun([aJob(0, "a", "queued", { asks })], { state: "running" });
  const sent = serve(() => [200, run]);
  show(<Problems run={run} job={null} />);
  expect(screen.getByTestId("asks-card")).toHaveTextContent("holds no solid now");
  fireEvent.click(screen.getByText("Go on without a solid"));
  const posted = () => sent.filter((one) => one.method === "POST");
  await waitFor(() => expect(posted()).toHaveLength(1));
  expect(posted()[0]?.body).toEqual({ stated: {} });
});

test("of a vessel that holds nothing by the record nothing can be stated", () => {
  serve(() => [200, { devices: [] }]);
  const states = { label: "Boils off", leaves_out: true, lots: [] };
  const asks = { text: "What?", states, is_due: true, confirmed_by: null, confirmed_at: null };
  show(<Problems run={aRun([aJob(0, "a", "queued", { asks })])} job={null} />);
  expect(screen.getByTestId("asks-card")).toHaveTextContent("holds no liquid");
});

test("who may not run things sees the question and a button that says why it is off", () => {
  serve(() => [200, { devices: [] }]);
  const asks = {
    text: "Go on?",
    states: null,
    is_due: true,
    confirmed_by: null,
    confirmed_at: null,
  };
  const run = aRun([aJob(0, "a", "queued", { asks })], { state: "running" });
  show(<Problems run={{ ...run, can: { ...run.can, confirm: false } }} job={null} />);
  expect(screen.getByTestId("asks-confirm")).toBeDisabled();
});

test("what is not due yet, or is confirmed, asks nobody", () => {
  serve(() => [200, { devices: [] }]);
  const asks = {
    text: "Go on?",
    states: null,
    is_due: false,
    confirmed_by: "Li Na",
    confirmed_at: iso(1),
  };
  show(<Problems run={aRun([aJob(0, "a", "queued", { asks })])} job={null} />);
  expect(screen.queryByTestId("asks-card")).toBeNull();
});
