// @vitest-environment jsdom
import { act, screen, waitFor } from "@testing-library/react";
import { expect, test, vi } from "vitest";
import { keys } from "@/api/keys";
import { client } from "@/api/live";
import { serve, show } from "@/testpage";
import { ApprovalsPage } from "./page";

const request = (id: string) => ({
  id,
  about: "run",
  title: `Start ${id}`,
  state: "open",
  asked_at: "2026-11-20T06:02:07Z",
  asked_by: { id: 1, name: "Li Na" },
  expires_at: null,
  decision: null,
  run: { id: "r", number: 1 },
  workflow: { id: "w", name: "Two transfers", version: 1 },
  policies: [],
  plan: { digest: "", estimate_s: 0, steps: [], jobs: [], notes: [], proved: null },
  materials: [],
});

test("a request that comes in takes the place of none that is being read", async () => {
  let ids = ["a"];
  serve((path) =>
    path.startsWith("/approvals?")
      ? [200, { requests: ids.map(request) }]
      : [200, request(path.replace("/approvals/", ""))],
  );
  vi.stubGlobal(
    "IntersectionObserver",
    class {
      observe(): void {}
      disconnect(): void {}
    },
  );
  show(<ApprovalsPage />, "/approvals");
  expect(await screen.findByRole("heading", { name: "Start a" })).toBeInTheDocument();
  ids = ["b", "a"];
  await act(() => client.invalidateQueries({ queryKey: keys.approvals }));
  await screen.findByText("Start b");
  expect(screen.getByRole("heading", { name: "Start a" })).toBeInTheDocument();
  ids = ["b"];
  await act(() => client.invalidateQueries({ queryKey: keys.approvals }));
  await waitFor(() => expect(screen.getAllByTestId("approval-row")).toHaveLength(1));
  expect(screen.getByRole("heading", { name: "Start a" })).toBeInTheDocument();
});
