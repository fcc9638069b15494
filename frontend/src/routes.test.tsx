// @vitest-environment jsdom
import { MantineProvider } from "@mantine/core";
import { QueryClientProvider } from "@tanstack/react-query";
import { act, render, screen, waitFor, within } from "@testing-library/react";
import { createMemoryRouter, RouterProvider, type RouteObject } from "react-router";
import { afterEach, beforeAll, beforeEach, expect, test, vi } from "vitest";
import { client } from "@/api/live";
import { routes } from "./routes";
import { SLOW_MS } from "./ui/pagestate";

const SESSION = {
  user: {
    id: 1,
    username: "li",
    name: "Li Na",
    initials: "LN",
    roles: ["chemist"],
    permissions: ["view", "draw", "submit", "stop", "reset"],
    lab_permissions: ["view", "draw", "submit", "stop", "reset"],
  },
  lab: {
    id: "l",
    key: "starter",
    name: "Starter lab",
    mode: "sim",
    time_zone: "UTC",
    speed: 1,
    stop: { is_stopped: false, stop_id: null, stopped_at: null, stopped_by: null, hosts: [] },
    counts: { runs_live: 0, approvals_open: 0, drivers_open: 0, needs_you: 0 },
  },
};

/** Every path of the site, its parameters filled in. */
function paths(list: RouteObject[], above = ""): string[] {
  return list.flatMap((route) => {
    const own = route.index ? above || "/" : `${above}/${route.path ?? ""}`.replace(/\/+/g, "/");
    if (route.children) return paths(route.children, own);
    return [own.replace(":id", "no-such-thing").replace("*", "nowhere")];
  });
}

const ALL = paths(routes);
const OF_ONE_THING = ALL.filter((path) => path.includes("no-such-thing"));

type Answer = () => Promise<Response>;
const json = (status: number, body: unknown): Promise<Response> =>
  Promise.resolve(new Response(JSON.stringify(body), { status }));
const MISSING: Answer = () => json(404, { code: "x.not_found", message: "there is none" });
const FAILING: Answer = () => json(500, {});
const SILENT: Answer = () => new Promise(() => undefined);

/** Open a page; everything but the session is answered by `answer`. */
function visit(path: string, answer: Answer): void {
  vi.stubGlobal("fetch", (url: string) =>
    url.endsWith("/session") ? json(200, SESSION) : answer(),
  );
  const router = createMemoryRouter(routes, { initialEntries: [path] });
  render(
    <MantineProvider env="test">
      <QueryClientProvider client={client}>
        <RouterProvider router={router} />
      </QueryClientProvider>
    </MantineProvider>,
  );
}

class NoSocket {
  static OPEN = 1;
  readyState = 0;
  send(): void {}
  close(): void {}
  addEventListener(): void {}
}

beforeAll(async () => {
  vi.stubGlobal("matchMedia", () => ({
    matches: false,
    addEventListener: () => undefined,
    removeEventListener: () => undefined,
  }));
  // Fetched once, so that no test waits for a module.
  const found = routes.flatMap((route) => route.children ?? []);
  await Promise.all(
    found.map((route) => (typeof route.lazy === "function" ? route.lazy() : undefined)),
  );
}, 120_000);

beforeEach(() => {
  client.clear();
  vi.stubGlobal("WebSocket", NoSocket);
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe(): void {}
      unobserve(): void {}
      disconnect(): void {}
    },
  );
  vi.spyOn(console, "error").mockImplementation(() => undefined);
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
});

const LONG = { timeout: 30_000 };

test("the pages of one thing are known to these tests", () => {
  expect(OF_ONE_THING).toHaveLength(9);
});

test.each(OF_ONE_THING)(
  "%s of something that does not exist leads to all of its kind",
  LONG,
  async (path) => {
    visit(path, MISSING);
    const told = await screen.findByTestId("missing", {}, LONG);
    expect(told).toHaveTextContent(/^This \w+ does not exist, or you may not see it\.Show/);
    expect(within(told).getByRole("link")).toHaveAttribute(
      "href",
      expect.stringMatching(/^\/\w+$/),
    );
  },
);

test.each(OF_ONE_THING)(
  "%s that cannot be had offers to try again and a way back",
  LONG,
  async (path) => {
    visit(path, FAILING);
    const told = await screen.findByTestId("failed", {}, LONG);
    expect(told).toHaveTextContent("The server answered 500.");
    expect(within(told).getByRole("button", { name: "Try again" })).toBeVisible();
    expect(within(told).getByRole("link")).toHaveAttribute(
      "href",
      expect.stringMatching(/^\/\w+$/),
    );
  },
);

test.each(ALL)(
  "%s is never white and never without a way out, whatever is answered",
  LONG,
  async (path) => {
    for (const body of [{}, null, [], { runs: [null] }, "text"]) {
      client.clear();
      visit(path, () => json(200, body));
      await waitFor(() => expect(screen.queryByTestId("starting")).toBeNull(), LONG);
      await act(() => new Promise((resolve) => setTimeout(resolve, 50)));
      expect(document.body.textContent).not.toBe("");
      const broken = screen.queryByTestId("broken");
      if (broken) {
        expect(within(broken).getByRole("button", { name: "Try again" })).toBeVisible();
        expect(within(broken).getAllByRole("link").length).toBeGreaterThan(0);
        expect(broken).toHaveTextContent("The lab is not affected");
      } else if (path !== "/login") {
        expect(screen.getAllByRole("link").length).toBeGreaterThan(0);
      }
      document.body.innerHTML = "";
    }
  },
);

test.each(OF_ONE_THING)(
  "%s says so when the server is slow, and ends its waiting",
  LONG,
  async (path) => {
    vi.useFakeTimers({ shouldAdvanceTime: true });
    visit(path, SILENT);
    await screen.findAllByTestId("loading", {}, LONG);
    await act(() => vi.advanceTimersByTimeAsync(SLOW_MS + 100));
    const waiting = screen.getAllByTestId("loading");
    for (const loading of waiting) {
      expect(loading).toHaveTextContent("The server has not answered yet.");
      expect(within(loading).getByRole("button", { name: "Try again" })).toBeVisible();
    }
    const links = waiting.flatMap((loading) => within(loading).queryAllByRole("link"));
    expect(links.map((link) => link.textContent)).toEqual([expect.stringMatching(/^Show /)]);
  },
);

test("an answer that is no JSON is told as such", LONG, async () => {
  visit("/runs/no-such-thing", () => Promise.resolve(new Response("<html>", { status: 200 })));
  const told = await screen.findByTestId("failed", {}, LONG);
  expect(told).toHaveTextContent("The server answered something that is no JSON.");
});

test("an address that leads nowhere names the pages near it", LONG, async () => {
  visit("/runs/a/b", SILENT);
  const told = await screen.findByTestId("not-found", {}, LONG);
  expect(within(told).getByRole("link", { name: "Show all runs" })).toHaveAttribute(
    "href",
    "/runs",
  );
});
