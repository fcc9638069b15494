// @vitest-environment jsdom
import { fireEvent, screen } from "@testing-library/react";
import { expect, test, vi } from "vitest";
import promises from "@/model/promises.json";
import type { Device } from "@/model/wire";
import { serve, show } from "@/testpage";
import { StopDevice } from "./stop";

const device = { id: "d", name: "Heater 1", state: "enrolled", halt: null } as unknown as Device;
const at = new Date().toISOString();
const owed = { state: "owed", message: "it does not answer", at, ended_at: null };
const halted = { state: "halted", message: "it stands", at, ended_at: at };

function page(change: object, permissions: string[], answer: [number, unknown] = [200, {}]) {
  const session = { user: { id: "u", username: "li", permissions }, lab: null };
  const sent = serve((path) => (path === "/session" ? [200, session] : answer));
  show(<StopDevice device={{ ...device, ...change }} />);
  return sent;
}

test("one click halts the device, and what it does is said before", async () => {
  const sent = page({}, ["stop"]);
  const about = Object.values(promises.stop_device).join(" ");
  expect(screen.getByTestId("stop-card")).toHaveTextContent(about);
  await vi.waitFor(() => expect(screen.getByTestId("stop-device")).toBeEnabled());
  fireEvent.click(screen.getByTestId("stop-device"));
  await vi.waitFor(() =>
    expect(sent.map((one) => [one.method, one.path])).toContainEqual([
      "POST",
      "/api/v1/devices/d/stop",
    ]),
  );
});

test("who may not stop it cannot", () => {
  page({}, ["view"]);
  expect(screen.getByTestId("stop-device")).toBeDisabled();
});

test("a halt that could not be delivered stays visible with its reason", () => {
  page({ halt: owed }, ["stop"]);
  expect(screen.getByTestId("halt")).toHaveTextContent(
    /^Not halted yet \d\d:\d\d it does not answer$/,
  );
});

test("a halt that was delivered is told with its time", () => {
  page({ halt: halted }, ["stop"]);
  expect(screen.getByTestId("halt")).toHaveTextContent(/^Halted \d\d:\d\d it stands$/);
});

test("a stop that was not confirmed says so", async () => {
  page({}, ["stop"], [503, { code: "x", message: "the database is away", findings: [] }]);
  await vi.waitFor(() => expect(screen.getByTestId("stop-device")).toBeEnabled());
  fireEvent.click(screen.getByTestId("stop-device"));
  await vi.waitFor(() => expect(screen.getByTestId("stop-failed")).toBeInTheDocument());
});
