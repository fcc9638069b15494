// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aRow } from "@/model/samples";
import type { Reservation, Resource } from "@/model/wire";
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
const rows = [aRow("bench_1", null, { name: "Bench 1", kind: "bench" }), flask];
const adas: Reservation = {
  id: "r1",
  resource: { id: "bench_1", name: "Bench 1" },
  holder: "Ada Lovelace",
  is_own: false,
  may_end: false,
  reason: "a long reflux",
  made_at: "2026-11-20T06:02:07Z",
  expires_at: "2026-11-20T08:02:07Z",
  ended_at: null,
};
const mine: Reservation = {
  ...adas,
  id: "r2",
  resource: { id: "flask_1", name: "Flask 1" },
  is_own: true,
  may_end: true,
  reason: "washes",
};

function lab(line: Reservation[], isAllowed = true): Sent[] {
  const sent = serve((path, method) => {
    if (method === "POST") return [200, {}];
    if (path === "/resources") return [200, { resources: rows }];
    if (path.endsWith("/reservations")) return [200, { is_allowed: isAllowed, reservations: line }];
    if (path.endsWith("/reaction")) return [200, { is_allowed: false, lots: [], materials: [] }];
    if (path.endsWith("/stock")) return [200, { is_allowed: true, why_not: null, lots: [] }];
    return [200, flask];
  });
  show(<LabPage />, "/lab?sel=flask_1");
  return sent;
}

const posted = (sent: Sent[]): Sent[] => sent.filter((one) => one.method === "POST");

test("the line is shown in its order, and only one's own can be ended", async () => {
  const sent = lab([adas, mine]);
  const [first, second] = await screen.findAllByTestId("reservation");
  expect(first).toHaveTextContent(/Bench 1.*by Ada Lovelace.*a long reflux/);
  expect(second).toHaveTextContent(/^Then.*by you.*washes/);
  expect(screen.getAllByTestId("reservation-end")).toHaveLength(1);
  await userEvent.click(screen.getByTestId("reservation-end"));
  await waitFor(() => {
    expect(posted(sent)).toMatchObject([{ path: "/api/v1/reservations/r2/end" }]);
  });
});

test("it is reserved for as long as was chosen, with a reason", async () => {
  const sent = lab([adas]);
  await waitFor(() => {
    expect(screen.getByTestId("reserve")).toBeEnabled();
  });
  await userEvent.click(screen.getByTestId("reserve"));
  expect(await screen.findByTestId("reserve-form")).toHaveTextContent(/yours comes after/);
  expect(screen.getByTestId("reserve-send")).toBeDisabled();
  await userEvent.click(screen.getByText("Other…"));
  await userEvent.type(screen.getByTestId("reserve-hours"), "1.5");
  await userEvent.type(screen.getByTestId("reserve-reason"), "a wash");
  await userEvent.click(screen.getByTestId("reserve-send"));
  await waitFor(() => {
    expect(posted(sent)).toMatchObject([
      {
        path: "/api/v1/reservations",
        body: { resource_ids: ["flask_1"], minutes: 90, reason: "a wash" },
      },
    ]);
  });
});

test("who may not run things on it may not reserve it", async () => {
  lab([], false);
  expect(await screen.findByTestId("reserve")).toBeDisabled();
  expect(screen.queryByTestId("reserved")).toBeNull();
});
