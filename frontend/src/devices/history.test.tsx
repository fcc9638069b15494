// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test, vi } from "vitest";
import type { Curves } from "@/model/curves";
import type { Device } from "@/model/wire";
import { serve, show } from "@/testpage";
import { History } from "./history";

vi.mock("@/ui/bandplot", () => ({
  BandPlot: ({ columns, unit }: { columns: unknown[][]; unit: string }) => (
    <div data-testid="drawn">
      {columns[0]?.length} {unit}
    </div>
  ),
}));
vi.mock("@/api/live", async (original) => ({
  ...(await original<Record<string, unknown>>()),
  listenTelemetry: () => () => undefined,
}));

const device = { id: "d", key: "heater_1", name: "Heater 1" } as Device;
const told: Curves = {
  since_s: 100,
  until_s: 1000,
  curves: [
    {
      status: "temperature_c",
      label: "Temperature",
      unit: "°C",
      every_s: 1,
      level_s: 60,
      step_s: 120,
      points: [
        [120, 20, 19, 21, 60],
        [240, 22, 21, 23, 60],
      ],
    },
  ],
  gaps: [{ since: 300, until: 320, lost_count: 7, reason: "overflow" }],
};
let answer: [number, unknown];

beforeEach(() => {
  answer = [200, told];
});

const open = () => {
  const sent = serve((path) => (path.includes("/telemetry/curves") ? answer : [200, device]));
  show(<History device={device} />);
  return sent;
};

test("curves are shown with their unit, their step and the gaps", async () => {
  open();
  expect(await screen.findByTestId("drawn")).toHaveTextContent("2 °C");
  expect(screen.getByText("mean of 2 min")).toBeInTheDocument();
  expect(screen.getByTestId("gaps")).toHaveTextContent("1 recorded gap, 7 samples lost");
});

test("another time is asked for by the keyboard alone", async () => {
  const sent = open();
  await screen.findByTestId("drawn");
  screen.getByRole("button", { name: "7 d" }).focus();
  await userEvent.keyboard("{Enter}");
  await waitFor(() => expect(sent.length).toBe(2));
  const asked = new URLSearchParams(sent[1]?.path.split("?")[1]);
  expect(Number(asked.get("until_s")) - Number(asked.get("since_s"))).toBeCloseTo(604800);
});

test("a time of one's own is asked for once it makes sense", async () => {
  const sent = open();
  await screen.findByTestId("drawn");
  await userEvent.click(screen.getByRole("button", { name: "Custom" }));
  expect(screen.getByTestId("empty")).toHaveTextContent("Choose when");
  const [from, to] = [screen.getByLabelText("From"), screen.getByLabelText("To")];
  await userEvent.clear(from);
  expect(screen.getByRole("alert")).toHaveTextContent("both");
  await userEvent.type(from, "2026-11-20T10:00:00");
  await userEvent.clear(to);
  await userEvent.type(to, "2026-11-20T09:00:00");
  expect(screen.getByRole("alert")).toHaveTextContent("after");
  expect(screen.getByRole("button", { name: "Show" })).toBeDisabled();
  await userEvent.clear(to);
  await userEvent.type(to, "2026-11-20T11:00:00");
  await userEvent.click(screen.getByRole("button", { name: "Show" }));
  await waitFor(() => expect(sent.at(-1)?.path).toContain("since_s=1795168800&until_s=1795172400"));
});

test("the range that is shown goes into files", async () => {
  open();
  await userEvent.click(await screen.findByTestId("export"));
  const link = await screen.findByTestId("export-1min-parquet");
  expect(link).toHaveAttribute(
    "href",
    "/api/v1/devices/d/telemetry/export?form=parquet&level=1min&since_s=100&until_s=1000",
  );
  expect(screen.getByTestId("export-raw-csv")).toBeInTheDocument();
});

test("nothing told, and nothing heard, are not the same", async () => {
  answer = [200, { ...told, curves: [] }];
  open();
  await waitFor(() => expect(screen.getByTestId("empty")).toHaveTextContent("no numbers"));
});

test("a server that refuses is quoted", async () => {
  answer = [403, { code: "x", message: "not today", effect: "none", context: {}, findings: [] }];
  open();
  expect(await screen.findByRole("alert")).toHaveTextContent("Not today");
});
