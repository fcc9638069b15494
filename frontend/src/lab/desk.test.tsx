// @vitest-environment jsdom
import { screen, waitFor, within } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aRow } from "@/model/samples";
import type { ReactionStock, Resource, Stock, Ticket } from "@/model/wire";
import { serve, show, type Sent } from "@/testpage";
import { LabPage } from "./page";

const water = { lot_id: "w", lot: "W-1", material: "Water", unit: "nl" } as const;
const salt = { lot_id: "s", lot: "S-1", material: "Salt", unit: "ug" } as const;
const allowed: Stock = { is_allowed: true, why_not: null, lots: [water, salt] };
const noReaction: ReactionStock = { is_allowed: false, lots: [], materials: [] };
const flask: Resource = {
  ...aRow("flask_2", null, {
    name: "Flask 2",
    is_quarantined: true,
    contents: [{ lot_id: "w", lot: "W-1", material: "Water", amount_nl: 5_000_000, amount_ug: 0 }],
    volume_nl: 5_000_000,
  }),
  config: {},
  data: {},
  data_told: {},
  extra: {},
  size_mm: null,
  ports: [],
  events: [],
  events_next: null,
};
const ticket: Ticket = {
  id: "t",
  code: "reconcile.drift",
  message: "edge and server read the same facts differently",
  detail: {
    transaction_id: "x",
    edge: { state: "committed", postings: [1] },
    server: { state: "committed", postings: [2] },
  },
  resources: [{ id: "flask_2", name: "Flask 2", is_quarantined: true }],
  host: null,
  opened_at: "2026-11-20T06:02:07Z",
  closed_at: null,
  closed_by: null,
  can_close: true,
};

type Answer = [status: number, body: unknown];

function lab(
  at: string,
  told: {
    stock?: Stock;
    reaction?: ReactionStock;
    resource?: Resource;
    ticket?: Ticket;
    post?: Answer;
  } = {},
): Sent[] {
  const resource = told.resource ?? flask;
  const sent = serve((path, method) => {
    if (method === "POST") return told.post ?? [201, {}];
    if (path === "/resources") return [200, { resources: [resource] }];
    if (path.endsWith("/reaction")) return [200, told.reaction ?? noReaction];
    if (path.endsWith("/stock")) return [200, told.stock ?? allowed];
    if (path.startsWith("/tickets/")) return [200, told.ticket ?? ticket];
    return [200, resource];
  });
  show(<LabPage />, at);
  return sent;
}

const posted = (sent: Sent[]): Sent[] => sent.filter((one) => one.method === "POST");
const AT = "/lab?sel=flask_2&stock=1";

test("the address of Home opens the dialog, and nothing can be sent before all was seen", async () => {
  lab(AT);
  expect(await screen.findByTestId("stock-form")).toBeInTheDocument();
  expect(screen.getByText(/By the record 5.00/)).toBeInTheDocument();
  expect(screen.getByTestId("stock-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("stock-reason"), "weighed");
  expect(screen.getByTestId("stock-send")).toBeDisabled();
});

test("what was seen is sent in whole nanolitres, after saying what will be written", async () => {
  const sent = lab(AT);
  await userEvent.type(await screen.findByTestId("stock-seen-w"), "4.2");
  await userEvent.type(screen.getByTestId("stock-reason"), "weighed");
  await userEvent.selectOptions(screen.getByTestId("stock-account"), "LOSS");
  const effects = screen.getByTestId("stock-effects");
  expect(effects).toHaveTextContent(/Water W-1: 4.20.mL; 0.80.mL goes to LOSS/);
  expect(effects).toHaveTextContent("The quarantine ends.");
  await userEvent.click(screen.getByTestId("stock-send"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]).toEqual({
    method: "POST",
    path: "/api/v1/operations",
    body: {
      operation: {
        op: "correct",
        resource_id: "flask_2",
        account: "LOSS",
        reason: "weighed",
        measured_nl: { w: 4_200_000 },
        measured_ug: {},
      },
    },
  });
  await waitFor(() => expect(screen.queryByTestId("stock-form")).toBeNull());
});

test("a syringe is set to empty by one press and a reason", async () => {
  const sent = lab(AT);
  await userEvent.click(await screen.findByTestId("stock-empty"));
  await userEvent.type(screen.getByTestId("stock-reason"), "emptied by hand");
  await userEvent.click(screen.getByTestId("stock-send"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]?.body).toMatchObject({
    operation: { op: "correct", measured_nl: {}, measured_ug: {} },
  });
});

test("a lot that the record does not know of is added, in its own unit", async () => {
  const sent = lab(AT);
  await userEvent.type(await screen.findByTestId("stock-seen-w"), "5 mL");
  await userEvent.type(screen.getByTestId("stock-add"), "Salt{Enter}");
  await userEvent.type(await screen.findByTestId("stock-seen-s"), "12");
  await userEvent.type(screen.getByTestId("stock-reason"), "crystals seen");
  await userEvent.click(screen.getByTestId("stock-send"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]?.body).toMatchObject({
    operation: { measured_nl: { w: 5_000_000 }, measured_ug: { s: 12_000 } },
  });
});

test.each(["-1", "5 g", "4,2", "much"])("an amount of %s is refused at its field", async (text) => {
  lab(AT);
  await userEvent.type(await screen.findByTestId("stock-seen-w"), text);
  await userEvent.type(screen.getByTestId("stock-reason"), "seen");
  const line = within(screen.getByTestId("stock-line"));
  expect(line.getByText(/less than nothing|no unit|decimal point|number and unit/)).toHaveClass(
    "bad",
  );
  expect(screen.getByTestId("stock-send")).toBeDisabled();
});

test("a refusal stands in the dialog with its code", async () => {
  const refusal = { code: "crutd.locked", message: "Flask 2 is in use", findings: [] };
  lab(AT, { post: [423, refusal] });
  await userEvent.click(await screen.findByTestId("stock-empty"));
  await userEvent.type(screen.getByTestId("stock-reason"), "seen");
  await userEvent.click(screen.getByTestId("stock-send"));
  expect(await screen.findByText("crutd.locked")).toBeInTheDocument();
  expect(screen.getByTestId("stock-form")).toBeInTheDocument();
});

test("who may not take stock sees a disabled button and no dialog", async () => {
  lab(AT, { stock: { ...allowed, is_allowed: false, why_not: "flask 2 is in use" } });
  expect(await screen.findByTestId("take-stock")).toBeDisabled();
  await userEvent.hover(screen.getByTestId("take-stock").parentElement ?? document.body);
  expect(await screen.findByText("Flask 2 is in use")).toBeInTheDocument();
  expect(screen.queryByTestId("stock-form")).toBeNull();
});

test("a quarantined thing that holds nothing asks for what was seen only", async () => {
  const heater = { ...flask, holds_liquid: false, contents: [], volume_nl: 0 };
  lab(AT, { resource: heater });
  expect(await screen.findByText(/It holds nothing/)).toBeInTheDocument();
  await userEvent.type(screen.getByTestId("stock-reason"), "cold");
  expect(screen.getByTestId("stock-send")).toBeEnabled();
});

test("a ticket shows where the two stories differ, and only there", async () => {
  lab("/lab?ticket=t");
  const text = within(await screen.findByTestId("ticket"));
  expect(text.getByText("reconcile.drift")).toBeInTheDocument();
  expect(text.getByRole("link", { name: "Flask 2" })).toHaveAttribute("href", "/lab?sel=flask_2");
  const stories = within(text.getByTestId("ticket-stories"));
  expect(stories.getByText("Postings")).toBeInTheDocument();
  expect(stories.queryByText("State")).toBeNull();
});

test("an open ticket leads to taking stock of each thing that it concerns", async () => {
  lab("/lab?ticket=t");
  const text = within(await screen.findByTestId("ticket"));
  const links = text.getAllByRole("link", { name: "Take stock…" });
  expect(links.map((one) => one.getAttribute("href"))).toEqual(
    ticket.resources.map((row) => `/lab?sel=${row.id}&stock=1`),
  );
});

test("a ticket leads to its run and its device, and shows no bare ids of them", async () => {
  const detail = { ...ticket.detail, run_id: "r7", device_id: "d7" };
  lab("/lab?ticket=t", { ticket: { ...ticket, detail } });
  const text = within(await screen.findByTestId("ticket"));
  const links = text.getAllByRole("link", { name: "Open" });
  expect(links.map((one) => one.getAttribute("href"))).toEqual(["/runs/r7", "/devices/d7"]);
  expect(text.queryByText("r7")).toBeNull();
});

test("a ticket is closed with a reason", async () => {
  const closed = { ...ticket, closed_at: "2026-11-20T07:00:00Z", closed_by: "Li Na" };
  const sent = lab("/lab?ticket=t", { post: [200, { ...closed, can_close: false }] });
  await userEvent.click(await screen.findByTestId("ticket-close"));
  expect(screen.getByTestId("ticket-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("ticket-reason"), "weighed both");
  await userEvent.click(screen.getByTestId("ticket-send"));
  expect(await screen.findByTestId("ticket-closed")).toHaveTextContent("Closed by Li Na");
  expect(posted(sent)[0]).toEqual({
    method: "POST",
    path: "/api/v1/tickets/t/close",
    body: { reason: "weighed both" },
  });
});

test("a ticket that was closed in between says so where it was asked", async () => {
  const refusal = { code: "ticket.closed", message: "this ticket is closed", findings: [] };
  lab("/lab?ticket=t", { post: [409, refusal] });
  await userEvent.click(await screen.findByTestId("ticket-close"));
  await userEvent.type(screen.getByTestId("ticket-reason"), "seen");
  await userEvent.click(screen.getByTestId("ticket-send"));
  expect(await screen.findByText("ticket.closed")).toBeInTheDocument();
});

test("who may not close a ticket reads it all the same", async () => {
  lab("/lab?ticket=t", { ticket: { ...ticket, can_close: false } });
  expect(await screen.findByTestId("ticket-close")).toBeDisabled();
});

const reaction: ReactionStock = {
  is_allowed: true,
  lots: [{ ...salt, amount: 50_000, density_mg_ul: null }],
  materials: [{ id: "m", name: "Oxide", density_mg_ul: null }],
};

test("a reaction is sent with its residue, once the masses agree", async () => {
  const sent = lab("/lab?sel=flask_2", { reaction });
  await waitFor(() => expect(screen.getByTestId("record-reaction")).toBeEnabled());
  await userEvent.click(screen.getByTestId("record-reaction"));
  await userEvent.type(await screen.findByTestId("consumed-s"), "48");
  await userEvent.click(screen.getByTestId("reaction-material"));
  await userEvent.click(await screen.findByText("Oxide"));
  await userEvent.type(screen.getByTestId("reaction-key"), "oxide-1");
  await userEvent.type(screen.getByTestId("reaction-amount"), "40");
  expect(screen.getByTestId("mass-balance")).toHaveTextContent(/stays in REACTION8.*mg/);
  expect(screen.getByTestId("reaction-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("reaction-reason"), "weighed");
  await userEvent.click(screen.getByTestId("reaction-send"));
  await waitFor(() => expect(posted(sent)).toHaveLength(1));
  expect(posted(sent)[0]?.body).toMatchObject({
    operation: {
      op: "react",
      reactants: [{ lot_id: "s", amount_ug: 48_000 }],
      products: [{ material_id: "m", key: "oxide-1", amount_ug: 40_000 }],
      residue_ug: 8_000,
    },
  });
}, 30_000);

test("who may not record what happened sees why", async () => {
  lab("/lab?sel=flask_2");
  await waitFor(() => expect(screen.getByTestId("record-reaction")).toBeDisabled());
});
