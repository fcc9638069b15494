// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aRow } from "@/model/samples";
import type { Custody, Resource } from "@/model/wire";
import { serve, show, type Sent } from "@/testpage";
import { LabPage } from "./page";

const flask: Resource = {
  ...aRow("flask_1", "bench_1", { name: "Flask 1", kind: "flask", holds_liquid: true }),
  config: {},
  data: {},
  data_told: {},
  extra: {},
  size_mm: null,
  ports: [],
  events: [],
  events_next: null,
};
const rows = [
  aRow("bench_1", null, { name: "Bench 1", kind: "bench" }),
  aRow("bench_9", null, { name: "Bench 9", kind: "bench" }),
  aRow("balance_1", null, { name: "Balance 1", kind: "balance" }),
  flask,
];
const still: Custody = {
  host: { id: "a", name: "Host 1" },
  move: null,
  connections: [],
  is_allowed: true,
  places: [
    { id: "bench_1", why_not: null },
    { id: "bench_9", why_not: null },
    { id: "balance_1", why_not: "it takes one thing at a time, and Vial 7 stands there" },
  ],
};
const leaving: NonNullable<Custody["move"]> = {
  id: "m",
  state: "leaving",
  from: { id: "a", name: "Host 1" },
  to: { id: "b", name: "Host 2" },
  place: { id: "bench_9", name: "Bench 9" },
  asked_by: "Ada Lovelace",
  asked_at: "2026-11-20T06:02:07Z",
  released_at: null,
  is_told: false,
};
const road = {
  ...leaving,
  state: "in_transit" as const,
  released_at: "2026-11-20T06:03:00Z",
};

function lab(custody: Custody, post: [number, unknown] = [200, {}]): Sent[] {
  const sent = serve((path, method) => {
    if (method === "POST") return post;
    if (path === "/resources") return [200, { resources: rows }];
    if (path.endsWith("/custody")) return [200, custody];
    if (path.endsWith("/reaction")) return [200, { is_allowed: false, lots: [], materials: [] }];
    if (path.endsWith("/stock")) return [200, { is_allowed: true, why_not: null, lots: [] }];
    return [200, flask];
  });
  show(<LabPage />, "/lab?sel=flask_1");
  return sent;
}

const posted = (sent: Sent[]): Sent[] => sent.filter((one) => one.method === "POST");

test("a vessel that its host has not let go says whose it is, and offers no receipt", async () => {
  lab({ ...still, host: null, move: leaving });
  const card = await screen.findByTestId("custody");
  expect(card).toHaveAttribute("data-step", "asked");
  expect(card).toHaveTextContent(/To be released.*from Host 1 to Host 2 since/);
  expect(card).toHaveTextContent("Asked for by Ada Lovelace");
  expect(card).toHaveTextContent("Release not confirmed yet");
  expect(screen.queryByTestId("custody-receive")).toBeNull();
  expect(screen.getByTestId("carry")).toBeDisabled();
});

test("a vessel in transit is received by one press of who may", async () => {
  const sent = lab({ ...still, host: null, move: road });
  const card = await screen.findByTestId("custody");
  expect(card).toHaveTextContent(/In transit.*from Host 1 to Host 2 since/);
  expect(card).toHaveTextContent("Release confirmed");
  await userEvent.click(screen.getByTestId("custody-receive"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]).toEqual({
    method: "POST",
    path: "/api/v1/handovers/m/arrived",
    body: {},
  });
});

test("who may not run things on it sees where it is and cannot receive it", async () => {
  lab({ ...still, host: null, move: road, is_allowed: false });
  expect(await screen.findByTestId("custody-receive")).toBeDisabled();
  expect(screen.getByTestId("carry")).toBeDisabled();
});

test("once its arrival was told nobody tells it again", async () => {
  lab({ ...still, host: null, move: { ...road, is_told: true } });
  expect(await screen.findByTestId("custody")).toHaveTextContent("Host 2 was told");
  expect(screen.queryByTestId("custody-receive")).toBeNull();
});

test("a refused receipt stands on the page with its code", async () => {
  const refusal = { code: "custody.told", message: "its new host was told already", findings: [] };
  lab({ ...still, host: null, move: road }, [409, refusal]);
  await userEvent.click(await screen.findByTestId("custody-receive"));
  expect(await screen.findByText("custody.told")).toBeInTheDocument();
});

test("a vessel is carried to a place of the lab, with a reason", async () => {
  const sent = lab(still, [202, { handover: { id: "m", state: "leaving" } }]);
  await waitFor(() => expect(screen.getByTestId("carry")).toBeEnabled());
  expect(screen.queryByTestId("custody")).toBeNull();
  await userEvent.click(screen.getByTestId("carry"));
  await userEvent.type(await screen.findByTestId("carry-place"), "Bench 9{Enter}");
  expect(screen.getByTestId("carry-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("carry-reason"), "to the oven");
  await userEvent.click(screen.getByTestId("carry-send"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]).toEqual({
    method: "POST",
    path: "/api/v1/operations",
    body: {
      operation: {
        op: "transfer_resource",
        resource_id: "flask_1",
        from_id: "bench_1",
        to_id: "bench_9",
      },
      note: "to the oven",
    },
  });
  await waitFor(() => expect(screen.queryByTestId("carry-form")).toBeNull());
});

test("a place without room is shown with the reason, and cannot be chosen", async () => {
  lab(still);
  await waitFor(() => expect(screen.getByTestId("carry")).toBeEnabled());
  await userEvent.click(screen.getByTestId("carry"));
  await userEvent.type(await screen.findByTestId("carry-place"), "Bal");
  const option = await screen.findByRole("option", { name: /Balance 1/ });
  expect(option).toHaveTextContent("It takes one thing at a time, and Vial 7 stands there");
  await userEvent.type(screen.getByTestId("carry-place"), "{Enter}");
  await userEvent.click(option);
  await userEvent.type(screen.getByTestId("carry-reason"), "to weigh it");
  expect(screen.getByTestId("carry-send")).toBeDisabled();
});

test("a vessel with tubes on it is not offered to be carried, and says what holds it", async () => {
  const connections: Custody["connections"] = [
    { key: "valve_1_4_flask_1", medium: "liquid", to: "Valve 1" },
    { key: "k", medium: "gas", to: "" },
  ];
  lab({ ...still, connections });
  const button = await screen.findByTestId("carry");
  expect(button).toBeDisabled();
  await screen.findByText("Nothing has happened to it yet.");
  await userEvent.hover(screen.getByTestId("carry").parentElement ?? document.body);
  const why = await screen.findAllByText(/^It is connected to/);
  expect(why[0]).toHaveTextContent(
    "It is connected to Valve 1 (liquid, valve_1_4_flask_1), something you may not see (gas), and cannot be carried.",
  );
});
