// @vitest-environment jsdom
import { fireEvent, screen, waitFor, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { Route, Routes } from "react-router";
import { beforeEach, expect, test, vi } from "vitest";
import { aDriver, aPlace, UNITS } from "@/model/samples";
import type { DriverDetail, DriverReading } from "@/model/wiredrivers";
import { serve, show } from "@/testpage";
import { DriversPage } from "./list";
import { DriverPage } from "./page";

const about = {
  roles: ["timer"],
  doc: "Waits.",
  quality: "bronze",
  imports: [],
  protocol: "none",
  safe_state: "",
  actions: [
    {
      name: "wait",
      label: "Wait",
      doc: "Wait.",
      schema: {
        properties: {
          duration_s: { type: "number", "x-unit": "s", "x-label": "Duration", maximum: 60 },
        },
        required: ["duration_s"],
      },
      hazards: [],
      recovery: "R0" as const,
    },
  ],
  statuses: [],
  config: {},
};
const old = aDriver({ id: "v1" });
const fresh = aDriver({
  id: "v2",
  digest: "ef56ab78".repeat(8),
  origin: "upload",
  state: "proposed",
  proposed_by: "Ada Admin",
  proposed_at: "2026-11-20T00:00:00Z",
  can: { read: true, decide: true, withdraw: true },
});
const detail: DriverDetail = {
  ...fresh,
  ...about,
  sources: { "drivers.virtual.timer": "one\ntwo\n" },
  request: {
    id: "q",
    state: "open",
    asked_at: "2026-11-20T00:00:00Z",
    expires_at: "2026-12-20T00:00:00Z",
    decision: null,
  },
  places: [aPlace()],
  tried: { actions: [], left_out: ["wait"], failed: [], statuses_were_read: false, faults: [] },
};
const changes = {
  modules: [
    {
      module: "drivers.virtual.timer",
      is_new: false,
      is_gone: false,
      removed_count: 1,
      added_count: 1,
      hunks: [
        [
          { sign: "-", before: 2, after: null, text: "zwei" },
          { sign: "+", before: null, after: 2, text: "two" },
        ],
      ],
    },
  ],
};
const reading: DriverReading = {
  ...about,
  module: "drivers.virtual.timer",
  class_name: "HostTimer",
  digest: fresh.digest,
  known: null,
};

let see: () => void = () => undefined;

beforeEach(() => {
  vi.unstubAllGlobals();
  vi.stubGlobal(
    "IntersectionObserver",
    class {
      constructor(callback: (entries: { isIntersecting: boolean }[]) => void) {
        see = () => callback([{ isIntersecting: true }]);
      }
      observe(): void {}
      disconnect(): void {}
    },
  );
});

const session = (onLab: string[]) => ({
  user: {
    id: "u",
    username: "u",
    name: "U",
    initials: "U",
    roles: [],
    permissions: ["view", "decide", "submit", "admit"],
    lab_permissions: onLab,
  },
  lab: null,
});

function answers(onLab: string[], more: Record<string, [number, unknown]> = {}) {
  return (path: string, method: string): [number, unknown] => {
    const special = more[`${method} ${path}`];
    if (special) return special;
    if (path === "/session") return [200, session(onLab)];
    if (path === "/drivers") return [200, { drivers: [fresh, old] }];
    if (path === "/drivers/v2") return [200, detail];
    if (path.endsWith("/parts")) return [200, { decision: "", changes: [], findings: [] }];
    if (path.includes("/changes/")) return [200, changes];
    if (path === "/steps") return [200, { steps: [], devices: [], units: UNITS }];
    return [404, { code: "http.not_found", message: "no such page" }];
  };
}

const page = (
  <Routes>
    <Route path="/drivers" element={<DriversPage />} />
    <Route path="/drivers/:id" element={<DriverPage />} />
  </Routes>
);

function pick(text = "class HostTimer: ..."): void {
  const file = new File([text], "timer.py", { type: "text/x-python" });
  fireEvent.change(screen.getByTestId("driver-input"), { target: { files: [file] } });
}

test("the list has one row for each driver, with what waits", async () => {
  serve(answers(["view"]));
  show(page, "/drivers");
  const row = await screen.findByTestId("driver-row");
  expect(row).toHaveTextContent("Waits for approval");
  expect(screen.getByTestId("bring-driver")).toBeDisabled();
  await userEvent.type(screen.getByTestId("driver-find"), "nothing like it");
  expect(screen.getByTestId("empty")).toHaveTextContent("No driver is like that");
});

test("who may decide in no more than a part of the lab reads which role is missing", async () => {
  const can = { read: true, decide: false, withdraw: false };
  serve(answers([], { "GET /drivers/v2": [200, { ...detail, can }] }));
  show(page, "/drivers/v2");
  expect(await screen.findByText("Needs the role approver on the whole lab.")).toBeInTheDocument();
});

test("a list that cannot be loaded says why", async () => {
  serve(answers(["view"], { "GET /drivers": [403, { code: "x", message: "not yours" }] }));
  show(page, "/drivers");
  expect(await screen.findByTestId("failed")).toHaveTextContent("Not yours");
});

test("a file that breaks rules is not proposed: each finding has its line", async () => {
  const finding = {
    code: "driver.drv011",
    message: "numpy is not among them",
    subject: "drivers/virtual/timer.py:2",
    context: { line: 2, suggestion: "import math" },
  };
  const refusal = { code: "driver.conformance", message: "it breaks rules", findings: [finding] };
  serve(answers(["submit"], { "POST /drivers/reading": [422, refusal] }));
  show(page, "/drivers");
  await waitFor(() => expect(screen.getByTestId("bring-driver")).toBeEnabled());
  await userEvent.click(screen.getByTestId("bring-driver"));
  pick();
  await waitFor(() => expect(screen.getByTestId("driver-model")).toHaveValue("timer"));
  expect(screen.getByTestId("driver-propose")).toBeDisabled();
  await userEvent.selectOptions(screen.getByTestId("driver-class"), "virtual");
  const found = await screen.findByTestId("driver-finding");
  expect(found).toHaveTextContent("drivers/virtual/timer.py:2 · DRV011");
  expect(found).toHaveTextContent("import math");
  expect(screen.getByTestId("driver-propose")).toBeDisabled();
});

test("a file that keeps the rules shows its form and is proposed", async () => {
  const sent = serve(
    answers(["submit"], {
      "POST /drivers/reading": [200, reading],
      "POST /drivers": [201, fresh],
    }),
  );
  show(page, "/drivers");
  await waitFor(() => expect(screen.getByTestId("bring-driver")).toBeEnabled());
  await userEvent.click(screen.getByTestId("bring-driver"));
  pick("text");
  await userEvent.selectOptions(screen.getByTestId("driver-class"), "virtual");
  const found = await screen.findByTestId("driver-found");
  expect(within(found).getByLabelText("Duration")).toBeInTheDocument();
  await userEvent.type(screen.getByTestId("driver-note"), "better");
  await userEvent.click(screen.getByTestId("driver-propose"));
  await screen.findByTestId("driver");
  expect(sent.find((one) => one.method === "POST" && one.path === "/api/v1/drivers")?.body).toEqual(
    { module: "drivers.virtual.timer", source: "text", note: "better" },
  );
});

test("nobody approves before the source or the changes were read to the end", async () => {
  const sent = serve(
    answers(["decide"], { "POST /drivers/v2/decision": [200, { ...fresh, state: "approved" }] }),
  );
  show(page, "/drivers/v2");
  expect(await screen.findByTestId("driver-approve")).toBeDisabled();
  expect(screen.getByTestId("driver-reject")).toBeDisabled();
  expect(await screen.findByText("zwei")).toBeInTheDocument();
  see();
  await waitFor(() => expect(screen.getByTestId("driver-approve")).toBeEnabled());
  await userEvent.click(screen.getByTestId("driver-approve"));
  await waitFor(() =>
    expect(sent.find((one) => one.path.endsWith("/decision"))?.body).toEqual({
      is_approved: true,
      comment: "",
    }),
  );
});

test("who brought it is told that a second person answers", async () => {
  const own = { ...detail, can: { read: true, decide: false, withdraw: true } };
  serve(answers(["decide"], { "GET /drivers/v2": [200, own] }));
  show(page, "/drivers/v2");
  expect(await screen.findByText(/a second person answers/)).toBeVisible();
  see();
  expect(screen.getByTestId("driver-approve")).toBeDisabled();
});

test("an approved version is given to a device with a reason", async () => {
  const approved = { ...detail, state: "approved" as const };
  const sent = serve(
    answers(["admit"], {
      "GET /drivers/v2": [200, approved],
      "GET /drivers": [200, { drivers: [{ ...fresh, state: "approved" }, old] }],
      "POST /devices/d1/driver": [200, aPlace().driver],
    }),
  );
  show(page, "/drivers/v2");
  await userEvent.click(await screen.findByTestId("driver-change"));
  expect(screen.getByTestId("change-version")).toHaveValue("v2");
  expect(screen.getByTestId("change-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("change-reason"), "better");
  await userEvent.click(screen.getByTestId("change-send"));
  await waitFor(() =>
    expect(sent.find((one) => one.path.endsWith("/d1/driver"))?.body).toEqual({
      version_id: "v2",
      reason: "better",
    }),
  );
});

test("a version is given to all devices that are ticked, in one call", async () => {
  const places = ["d1", "d2", "d3", "d4"].map((id) =>
    aPlace({ id, key: id, name: `Pump ${id}`, can_change: id !== "d4" }),
  );
  const none = { decision: "", changes: [], findings: [] };
  const sent = serve(
    answers(["admit"], {
      "GET /drivers/v2": [200, { ...detail, state: "approved" as const, places }],
      "GET /devices/d1/driver/v2/parts": [200, none],
      "GET /devices/d2/driver/v2/parts": [200, none],
      "GET /devices/d3/driver/v2/parts": [200, { ...none, decision: "d".repeat(64) }],
      "POST /drivers/v2/devices": [200, { devices: [] }],
    }),
  );
  show(page, "/drivers/v2");
  await userEvent.click(await screen.findByTestId("driver-many"));
  const dialog = within(screen.getByTestId("many-dialog"));
  expect(await dialog.findByText(/Its parts change/)).toBeVisible();
  const boxes = dialog.getAllByTestId("many-device");
  expect(boxes.map((box) => box.dataset.device)).toEqual(["d1", "d2", "d3"]);
  expect(boxes[2]).toBeDisabled();
  expect(screen.getByTestId("many-send")).toBeDisabled();
  await userEvent.click(screen.getByTestId("many-all"));
  expect(screen.getByTestId("many-send")).toHaveTextContent("Give to 2");
  await userEvent.type(screen.getByTestId("many-reason"), "better");
  await userEvent.click(screen.getByTestId("many-send"));
  await waitFor(() =>
    expect(sent.find((one) => one.path.endsWith("/v2/devices"))?.body).toEqual({
      devices: [{ device_id: "d1" }, { device_id: "d2" }],
      reason: "better",
    }),
  );
  await waitFor(() => expect(screen.queryByTestId("many-dialog")).toBeNull());
});

test("of more devices than one call takes the first are listed, and the rest told of", async () => {
  const places = Array.from({ length: 201 }, (_, index) =>
    aPlace({ id: `d${index}`, key: `d${index}`, name: `Pump ${index}` }),
  );
  serve(
    answers(["admit"], {
      "GET /drivers/v2": [200, { ...detail, state: "approved" as const, places }],
    }),
  );
  show(page, "/drivers/v2");
  await userEvent.click(await screen.findByTestId("driver-many"));
  expect(screen.getByText(/first 200 of 201/)).toBeVisible();
  expect(screen.getAllByTestId("many-device")).toHaveLength(200);
});

test("where a version is given to one device alone, nothing is offered for several", async () => {
  serve(
    answers(["admit"], { "GET /drivers/v2": [200, { ...detail, state: "approved" as const }] }),
  );
  show(page, "/drivers/v2");
  await screen.findByTestId("driver-change");
  expect(screen.queryByTestId("driver-many")).toBeNull();
});

test("who gives a version with other parts sees and agrees to each of them", async () => {
  const parts = {
    decision: "d".repeat(64),
    changes: [
      { code: "driver.parts_lost", message: "Pump has no more a rotary valve", subject: "p_valve" },
    ],
    findings: [] as object[],
  };
  const given = (found: object[]) =>
    answers(["admit"], {
      "GET /drivers/v2": [200, { ...detail, state: "approved" as const }],
      "GET /devices/d1/driver/v2/parts": [200, { ...parts, findings: found }],
      "POST /devices/d1/driver": [200, aPlace().driver],
    });
  const sent = serve(given([]));
  const { unmount } = show(page, "/drivers/v2");
  await userEvent.click(await screen.findByTestId("driver-change"));
  expect(await screen.findByText(/has no more a rotary valve/)).toBeVisible();
  await userEvent.type(screen.getByTestId("change-reason"), "broken");
  expect(screen.getByTestId("change-send")).toBeDisabled();
  await userEvent.click(screen.getByTestId("part-agree"));
  await userEvent.click(screen.getByTestId("change-send"));
  await waitFor(() =>
    expect(sent.find((one) => one.path.endsWith("/d1/driver"))?.body).toEqual({
      version_id: "v2",
      reason: "broken",
      parts: parts.decision,
    }),
  );
  unmount();
  serve(given([{ code: "crutd.connected", message: "take the tube off first", subject: "t" }]));
  show(page, "/drivers/v2");
  await userEvent.click(await screen.findByTestId("driver-change"));
  expect(await screen.findByText("take the tube off first")).toBeVisible();
  expect(screen.queryByTestId("part-agree")).toBeNull();
  expect(screen.getByTestId("change-send")).toBeDisabled();
});

test("who may not read source is told so, and sees the rest", async () => {
  const plain = { ...detail, sources: {}, can: { read: false, decide: false, withdraw: false } };
  serve(answers([], { "GET /drivers/v2": [200, plain] }));
  show(page, "/drivers/v2");
  expect(await screen.findByTestId("driver-hidden")).toHaveTextContent(/role approver or admin/);
  expect(screen.queryByTestId("driver-source")).toBeNull();
  expect(screen.queryByTestId("driver-changes")).toBeNull();
  expect(screen.getByTestId("driver-places")).toBeVisible();
});

test("a version that is not approved is given to nobody", async () => {
  serve(answers(["admit"]));
  show(page, "/drivers/v2");
  expect(await screen.findByTestId("driver-change")).toBeDisabled();
});

test("a change under way shows its stages, and can be taken back", async () => {
  const next = { version_id: "v2", digest: fresh.digest, is_ready: true };
  const places = [aPlace({ driver: { ...aPlace().driver, next } })];
  const approved = { ...detail, state: "approved" as const, places };
  const sent = serve(
    answers(["admit"], {
      "GET /drivers/v2": [200, approved],
      "POST /devices/d1/driver": [200, aPlace().driver],
    }),
  );
  show(page, "/drivers/v2");
  const place = await screen.findByTestId("driver-place");
  expect(place).toHaveAttribute("data-stage", "ready");
  expect(
    within(place)
      .getAllByRole("listitem")
      .map((li) => li.dataset.done),
  ).toEqual(["true", "true", "false"]);
  await userEvent.click(within(place).getByTestId("driver-change"));
  await userEvent.type(screen.getByTestId("change-reason"), "wrong one");
  await userEvent.click(screen.getByTestId("change-send"));
  await waitFor(() =>
    expect(sent.find((one) => one.path.endsWith("/d1/driver"))?.body).toEqual({
      version_id: "v1",
      reason: "wrong one",
    }),
  );
});
