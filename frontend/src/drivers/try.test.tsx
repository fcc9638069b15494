// @vitest-environment jsdom
import { screen, waitFor, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { Route, Routes } from "react-router";
import { beforeEach, expect, test, vi } from "vitest";
import { aDriver, UNITS } from "@/model/samples";
import type { DriverDetail } from "@/model/wiredrivers";
import type { Tryout, Tryouts } from "@/model/wiretryouts";
import { serve, show, type Sent } from "@/testpage";
import { TryPage } from "./try";

const tried = {
  actions: [],
  left_out: ["heat"],
  failed: [],
  statuses_were_read: false,
  faults: [],
};
const driver: DriverDetail = {
  ...aDriver({ id: "v1" }),
  roles: [],
  imports: [],
  protocol: "",
  safe_state: "",
  actions: [
    {
      name: "heat",
      label: "Heat",
      doc: "Heat.",
      schema: {
        properties: {
          temperature_c: { type: "number", "x-unit": "°C", "x-label": "Temperature", maximum: 80 },
        },
        required: ["temperature_c"],
      },
      hazards: [],
      recovery: "R0" as const,
    },
  ],
  statuses: [{ name: "temperature_c", label: "Reading", doc: "", unit: "°C" }],
  config: {},
  sources: {},
  request: null,
  places: [],
  tried,
};
const about: Tryouts = {
  hosts: [
    {
      id: "h1",
      name: "Host 1",
      problem: null,
      models: [{ model: "bath", title: "Bath 9", carriers: ["pty"], settings: {} }],
    },
  ],
  fastest: 100,
  tried,
  tryouts: [],
};
const running: Tryout = {
  id: "t1",
  host: { id: "h1", name: "Host 1" },
  model: "bath",
  title: "Bath 9",
  speed: 10,
  state: "running",
  code: "",
  message: "",
  begun_by: "Ada",
  begun_at: "2026-11-22T10:00:00Z",
  ended_at: null,
  driver_id: "v1",
  settings: {},
  config: {},
  faults_offered: { slow_reply: { properties: { delay_s: { type: "number" } } } },
  faults: [],
  statuses: { values: { temperature_c: 21.5 }, problems: {} },
  acts: [],
  wire: [{ n: 1, at_s: 0.25, direction: "in", hex: "494e0d" }],
  wire_left_out_count: 0,
};

const ada = { username: "ada", printed_name: "Ada", permissions: ["submit"] };
let onLab: string[] = [];
let tryout: Tryout = running;

function page(at: string): Sent[] {
  const sent = serve((path, method) => {
    if (path === "/session") return [200, { user: { ...ada, lab_permissions: onLab }, lab: null }];
    if (path === "/steps") return [200, { steps: [], devices: [], units: UNITS }];
    if (path === "/drivers/v1") return [200, driver];
    if (path === "/drivers/v1/tryouts") return method === "GET" ? [200, about] : [201, tryout];
    if (path === "/tryouts/t1") return [200, tryout];
    if (path === "/tryouts/t1/wishes") return [201, {}];
    return [404, { error: { code: "http.not_found", message: path } }];
  });
  show(
    <Routes>
      <Route path="/drivers/:id/try" element={<TryPage />} />
    </Routes>,
    at,
  );
  return sent;
}

beforeEach(() => {
  vi.unstubAllGlobals();
  onLab = ["submit"];
  tryout = running;
});

test("an instrument is chosen and a tryout begun on it", async () => {
  const user = userEvent.setup();
  const sent = page("/drivers/v1/try");
  expect(await screen.findByTestId("try-begin")).toBeDisabled();
  await user.selectOptions(screen.getByTestId("try-model"), "bath");
  await waitFor(() => expect(screen.getByTestId("try-begin")).toBeEnabled());
  await user.click(screen.getByTestId("try-begin"));
  await waitFor(() =>
    expect(sent.find((one) => one.method === "POST")?.body).toEqual({
      host_id: "h1",
      model: "bath",
      settings: {},
      config: {},
      speed: 10,
    }),
  );
});

test("who may bring drivers to no more than a part of the lab reads why nothing can be begun", async () => {
  onLab = [];
  page("/drivers/v1/try");
  await userEvent.selectOptions(await screen.findByTestId("try-model"), "bath");
  expect(screen.getByText("Needs the role admin on the whole lab.")).toBeInTheDocument();
  expect(screen.getByTestId("try-begin")).toBeDisabled();
});

test("an action is asked for by its own form, and what crossed the line is read as text", async () => {
  const user = userEvent.setup();
  const sent = page("/drivers/v1/try?on=t1");
  const action = await screen.findByTestId("try-action");
  await user.type(within(action).getByLabelText("Temperature"), "60");
  await user.click(within(action).getByTestId("try-do"));
  await waitFor(() =>
    expect(sent.find((one) => one.method === "POST")?.body).toEqual({
      sort: "act",
      name: "heat",
      args: { temperature_c: 60 },
    }),
  );
  expect(screen.getByTestId("try-status")).toHaveTextContent("21.5");
  expect(screen.getByTestId("try-record")).toHaveTextContent("IN\\r");
});

test("a fault is switched on with its options", async () => {
  const user = userEvent.setup();
  const sent = page("/drivers/v1/try?on=t1");
  await user.click(await screen.findByTestId("try-fault-open"));
  await user.type(screen.getByLabelText(/delay_s/), "2");
  await user.click(screen.getByTestId("try-fault-on"));
  await waitFor(() =>
    expect(sent.find((one) => one.method === "POST")?.body).toEqual({
      sort: "fault",
      name: "slow_reply",
      args: { delay_s: 2 },
    }),
  );
});

test("while one action runs no other is asked for, and it can be stopped", async () => {
  const act = {
    number: 1,
    sort: "act" as const,
    name: "heat",
    args: {},
    asked_at: "2026-11-22T10:00:00Z",
    answered_at: null,
    code: "",
    message: "",
    effect: "",
    data: {},
    has_faults: false,
  };
  tryout = { ...running, acts: [act] };
  page("/drivers/v1/try?on=t1");
  expect(await screen.findByTestId("try-do")).toBeDisabled();
  expect(screen.getByTestId("try-stop")).toBeEnabled();
});

test("a tryout that has ended says why, and asks for nothing more", async () => {
  tryout = { ...running, state: "ended", message: "its author ended it" };
  page("/drivers/v1/try?on=t1");
  expect(await screen.findByTestId("try-note")).toHaveTextContent("its author ended it");
  expect(screen.getByTestId("try-read")).toBeDisabled();
  expect(screen.getByTestId("try-again")).toBeInTheDocument();
});
