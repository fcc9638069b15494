// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { aRow } from "@/model/samples";
import type { Resource } from "@/model/wire";
import { serve, show, type Sent } from "@/testpage";
import { LabPage } from "./page";

const connection = {
  connection_id: "c",
  key: "tube_1",
  source_id: "valve_1",
  source_port: "3",
  target_id: "mixer_1",
  target_port: "in",
  medium: "liquid",
};

function lab(fields: Partial<Resource["ports"][number]>, post: [number, unknown]): Sent[] {
  const medium = fields.medium ?? "liquid";
  const mixer: Resource = {
    ...aRow("mixer_1", null, { name: "Mixer 1", kind: "stirrer" }),
    config: {},
    data: {},
    data_told: {},
    extra: {},
    size_mm: null,
    ports: [
      {
        port: "in",
        to: { id: "valve_1", name: "Valve 1", port: "3" },
        medium,
        connection: { ...connection, medium },
        may_disconnect: true,
        ...fields,
      },
    ],
    events: [],
    events_next: null,
  };
  const sent = serve((path, method) => {
    if (method === "POST") return post;
    if (path === "/resources") return [200, { resources: [mixer] }];
    if (path.endsWith("/stock")) return [200, { is_allowed: true, why_not: null, lots: [] }];
    return [200, mixer];
  });
  show(<LabPage />, "/lab?sel=mixer_1");
  return sent;
}

test("a tube is taken off by who has seen it empty, with a reason, as it was shown", async () => {
  const sent = lab({}, [201, {}]);
  await userEvent.click(await screen.findByTestId("take-off"));
  expect(screen.getByTestId("take-off-send")).toBeDisabled();
  await userEvent.type(screen.getByTestId("take-off-reason"), "the mixer goes");
  expect(screen.getByTestId("take-off-send")).toBeDisabled();
  await userEvent.click(screen.getByTestId("take-off-empty"));
  await userEvent.click(screen.getByTestId("take-off-send"));
  await waitFor(() => expect(screen.queryByTestId("take-off-form")).toBeNull());
  expect(sent.find((one) => one.method === "POST")).toMatchObject({
    path: "/api/v1/operations",
    body: {
      operation: { op: "disconnect", ...connection, is_seen_empty: true },
      note: "the mixer goes",
    },
  });
});

test("a wire needs no look inside", async () => {
  lab({ medium: "electrical" }, [201, {}]);
  await userEvent.click(await screen.findByTestId("take-off"));
  expect(screen.queryByTestId("take-off-empty")).toBeNull();
  await userEvent.type(screen.getByTestId("take-off-reason"), "rewired");
  expect(screen.getByTestId("take-off-send")).toBeEnabled();
});

test("what the server refuses is said, and the dialog stays", async () => {
  const message = "run #7, move water, goes from Valve 1 to Mixer 1: let the run end, or stop it";
  lab({}, [412, { code: "device.has_job", message, effect: "none", findings: [] }]);
  await userEvent.click(await screen.findByTestId("take-off"));
  await userEvent.type(screen.getByTestId("take-off-reason"), "the mixer goes");
  await userEvent.click(screen.getByTestId("take-off-empty"));
  await userEvent.click(screen.getByTestId("take-off-send"));
  expect(await screen.findByTestId("take-off-form")).toHaveTextContent(
    /goes from Valve 1 to Mixer 1: let the run end/,
  );
});

test("who may not admit devices there is told so, and can press nothing", async () => {
  lab({ may_disconnect: false }, [403, {}]);
  expect(await screen.findByTestId("take-off")).toBeDisabled();
});
