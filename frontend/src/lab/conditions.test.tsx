// @vitest-environment jsdom
import { screen, within } from "@testing-library/react";
import { expect, test } from "vitest";
import { aRow } from "@/model/samples";
import type { Resource } from "@/model/wire";
import { serve, show } from "@/testpage";
import { LabPage } from "./page";

const heater = aRow("heater_1", null, {
  name: "Heater 1",
  kind: "heater_stirrer",
  device: { id: "d1", name: "Heater 1" },
});
const reactor: Resource = {
  ...aRow("reactor_1", "heater_1", { name: "Reactor 1", kind: "reactor", holds_liquid: true }),
  config: { temperature_c: 22 },
  data: { speed_setpoint_rpm: 400, mass_mg: 12, temperature_setpoint_c: null },
  data_told: {
    speed_setpoint_rpm: { how: "set", at: "2026-11-20T06:02:07Z", job_id: "j" },
    mass_mg: { how: "measured", at: "2026-11-20T06:03:07Z", job_id: null },
    temperature_setpoint_c: { how: "unknown", at: "2026-11-20T06:04:07Z", job_id: null },
  },
  extra: {},
  size_mm: null,
  ports: [],
  events: [],
  events_next: null,
};

function lab(resource: Resource): void {
  const reading = { status: "temperature_c", label: "Temperature", unit: "°C" };
  const device = {
    id: "d1",
    name: "Heater 1",
    readings: [
      { ...reading, value: 58.3, at_s: 1_795_000_000 },
      { ...reading, status: "is_idle", label: "Idle", unit: "", value: true, at_s: 1 },
    ],
  };
  serve((path) => {
    if (path === "/resources") return [200, { resources: [heater, resource] }];
    if (path === "/devices") return [200, { devices: [device] }];
    if (path.endsWith("/reservations")) return [200, { is_allowed: true, reservations: [] }];
    if (path.endsWith("/stock")) return [200, { is_allowed: true, why_not: null, lots: [] }];
    if (path.endsWith("/reaction")) return [200, { is_allowed: false, lots: [], materials: [] }];
    return [200, resource];
  });
  show(<LabPage />, "/lab?sel=reactor_1");
}

test("a declared temperature is never shown as measured, and what is measured says by what", async () => {
  lab(reactor);
  const declared = await screen.findByTestId("declared");
  expect(declared).toHaveTextContent(/Nothing of it was measured.*Temperature22/);
  const known = screen.getByTestId("known");
  await within(known).findByRole("link", { name: "Heater 1" });
  expect(known).toHaveTextContent(/400.*set by a run, .*12.*measured by a person, .*unknown since/);
  expect(known).toHaveTextContent(/Temperature58\.3.°C read by Heater 1/);
  expect(known).not.toHaveTextContent(/22|Idle/);
});

test("a vessel that nothing reads says so", async () => {
  lab({ ...reactor, parent_id: null, data: {}, data_told: {} });
  expect(await screen.findByTestId("known")).toHaveTextContent("no device reads it");
});
