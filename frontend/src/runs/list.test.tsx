// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import type { RunRow } from "@/model/wire";
import { serve, show } from "@/testpage";
import { RunsPage } from "./list";

const run = (number: number): RunRow =>
  ({
    id: `r${number}`,
    number,
    state: "complete",
    mode: "sim",
    workflow: { id: "w", name: "Move", version: 1 },
    steps_done: 1,
    steps_total: 1,
    step_now: null,
    left_s: null,
    in_doubt_count: 0,
    waits_for: null,
    recoveries: [],
    started_at: null,
    created_at: "2026-01-01T00:00:00Z",
    created_by: "Ada",
  }) as unknown as RunRow;

function answer(path: string): [number, unknown] {
  if (!path.startsWith("/runs?")) return [200, {}];
  const after = new URLSearchParams(path.split("?")[1]).get("after");
  if (after === "two/") return [200, { runs: [run(1)], next: null }];
  return [200, { runs: [run(3), run(2)], next: "two/" }];
}

test("a list of runs says that there are more, and shows them when asked", async () => {
  const sent = serve(answer);
  show(<RunsPage />, "/runs?state=complete");
  await screen.findByText("#3");
  expect(screen.queryByText("#1")).toBeNull();
  expect(screen.getByTestId("more").textContent).toContain("The newest 2 runs are shown.");
  expect(screen.getByText("2+")).toBeTruthy();
  await userEvent.click(screen.getByRole("button", { name: "Show more runs" }));
  await screen.findByText("#1");
  expect(screen.getAllByTestId("run-row")).toHaveLength(3);
  await waitFor(() => expect(screen.queryByTestId("more")).toBeNull());
  const paths = sent.map((one) => one.path).filter((path) => path.includes("/runs?"));
  expect(paths).toEqual([
    "/api/v1/runs?state=complete&limit=100",
    "/api/v1/runs?state=complete&limit=100&after=two%2F",
  ]);
});
