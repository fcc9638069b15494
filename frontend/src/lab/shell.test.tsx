// @vitest-environment jsdom
import { act, screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { beforeEach, expect, test } from "vitest";
import { useConnection } from "@/api/connection";
import { useSession } from "@/api/queries";
import type { Lab, User } from "@/model/wire";
import { serve, show } from "@/testpage";
import { LoginPage, isDrawnByServer, safeNext } from "./login";
import { StopBanner, StopButton, useReset } from "./stop";

const lab: Lab = {
  id: "l",
  key: "starter",
  name: "Starter lab",
  mode: "sim",
  time_zone: "UTC",
  speed: 1,
  stop: { is_stopped: false, stop_id: null, stopped_at: null, stopped_by: null, hosts: [] },
  counts: { runs_live: 0, approvals_open: 0, drivers_open: 0, needs_you: 0 },
};
const user: User = {
  id: "1",
  username: "li",
  name: "Li Na",
  initials: "LN",
  roles: ["approver"],
  password_from: "own",
  permissions: ["view", "stop", "reset"],
  lab_permissions: ["view", "stop", "reset"],
};
const stopped: Lab = {
  ...lab,
  stop: {
    is_stopped: true,
    stop_id: "s",
    stopped_at: "2026-11-20T06:02:07Z",
    stopped_by: "Li Na",
    hosts: [
      {
        id: "h1",
        name: "bench-1",
        state: "online",
        acknowledged_at: "2026-11-20T06:02:07Z",
        after_s: 0.21,
      },
      { id: "h2", name: "bench-2", state: "isolated", acknowledged_at: null, after_s: null },
    ],
  },
};

beforeEach(() => useConnection.setState({ isOpen: true, isReachable: true }));

test("one press stops the lab, without a question", async () => {
  const sent = serve(() => [200, stopped]);
  show(<StopButton />);
  await userEvent.click(screen.getByTestId("stop-lab"));
  expect(sent).toEqual([{ method: "POST", path: "/api/v1/lab/stop", body: {} }]);
});

test("a stop that was not confirmed says to use the red button", async () => {
  serve(() => [500, {}]);
  show(<StopButton />);
  await userEvent.click(screen.getByTestId("stop-lab"));
  expect(await screen.findByTestId("stop-failed")).toHaveTextContent("red button on the bench");
});

function Told() {
  const session = useSession().data;
  return session?.lab ? <StopBanner lab={session.lab} user={user} /> : null;
}

test("an answer that comes after later news of the hosts does not hide it", async () => {
  const [one] = stopped.stop.hosts;
  const later = { ...stopped, stop: { ...stopped.stop, hosts: [one] } };
  const sent = serve((path) => [200, path === "/session" ? { user, lab: later } : stopped]);
  show(
    <>
      <StopButton />
      <Told />
    </>,
  );
  expect(await screen.findAllByTestId("stop-host")).toHaveLength(1);
  await userEvent.click(screen.getByTestId("stop-lab"));
  const asked = ["/session", "/lab/stop", "/session"].map((path) => `/api/v1${path}`);
  await waitFor(() => expect(sent.map((one) => one.path)).toEqual(asked));
  await waitFor(() => expect(screen.getAllByTestId("stop-host")).toHaveLength(1));
});

test("Stop lab is disabled only when the browser is offline, and says so", () => {
  useConnection.setState({ isOpen: false, isReachable: false });
  show(<StopButton />);
  expect(screen.getByTestId("stop-lab")).toBeDisabled();
  expect(screen.getByText("Not connected – use the hardware stop.")).toBeInTheDocument();
});

test("without the stream but with a server that answers it can still be pressed", () => {
  useConnection.setState({ isOpen: false, isReachable: true, hasBeenOpen: true });
  show(<StopButton />);
  expect(screen.getByTestId("stop-lab")).toBeEnabled();
});

test("each host is listed, and a silent one is named", () => {
  show(<StopBanner lab={stopped} user={user} />);
  const hosts = screen.getAllByTestId("stop-host");
  expect(hosts.map((host) => host.dataset.state)).toEqual(["acknowledged", "waiting"]);
  expect(hosts[1]).toHaveClass("late");
});

test("a silent host is named within a second or two also where the browser's clock is behind", async () => {
  const ahead = { ...stopped.stop, stopped_at: new Date(Date.now() + 60_000).toISOString() };
  show(<StopBanner lab={{ ...stopped, stop: ahead }} user={user} />);
  const silent = screen.getAllByTestId("stop-host")[1];
  expect(silent).not.toHaveClass("late");
  await waitFor(() => expect(silent).toHaveClass("late"), { timeout: 2500 });
});

test("reset asks for the reason, and sends it", async () => {
  const sent = serve(() => [200, lab]);
  show(<StopBanner lab={stopped} user={user} />);
  await userEvent.click(screen.getByTestId("reset-lab"));
  expect(await screen.findByTestId("reset-confirm")).toBeDisabled();
  await userEvent.type(screen.getByTestId("reset-reason"), "bench is dry");
  await userEvent.click(screen.getByTestId("reset-confirm"));
  await waitFor(() =>
    expect(sent).toContainEqual({
      method: "POST",
      path: "/api/v1/lab/reset",
      body: { reason: "bench is dry" },
    }),
  );
});

test("a stop that ends while its question stands open leaves none to the next stop", async () => {
  const page = show(<StopBanner lab={stopped} user={user} />);
  await userEvent.click(screen.getByTestId("reset-lab"));
  await userEvent.type(await screen.findByTestId("reset-reason"), "bench is dry");
  page.rerender(<StopBanner lab={lab} user={user} />);
  const next = { ...stopped, stop: { ...stopped.stop, stop_id: "t" } };
  page.rerender(<StopBanner lab={next} user={user} />);
  expect(screen.queryByTestId("reset-reason")).not.toBeInTheDocument();
  await userEvent.click(screen.getByTestId("reset-lab"));
  expect(await screen.findByTestId("reset-reason")).toHaveValue("");
});

test("a question about a stop that was over already does not open with the next", async () => {
  const page = show(<StopBanner lab={lab} user={user} />);
  act(() => useReset.getState().ask("the one before"));
  page.rerender(<StopBanner lab={stopped} user={user} />);
  expect(screen.queryByTestId("reset-reason")).not.toBeInTheDocument();
});

test("who may reset no more than a part of the lab sees a disabled button", () => {
  show(<StopBanner lab={stopped} user={{ ...user, lab_permissions: [] }} />);
  expect(screen.getByTestId("reset-lab")).toBeDisabled();
});

test.each([
  ["/runs/1?tab=logs", "/runs/1?tab=logs"],
  ["//evil.example", "/"],
  ["/\\evil.example", "/"],
  ["https://evil.example", "/"],
  ["/login?next=/", "/"],
  [null, "/"],
])("after sign-in %s leads to %s", (next, expected) => {
  expect(safeNext(next)).toBe(expected);
});

test.each([
  ["/admin/", true],
  ["/admin/enrollment/device/", true],
  ["/api/docs/", true],
  ["/administration", false],
  ["/runs/1", false],
])("%s is drawn by the server: %s", (path, expected) => {
  expect(isDrawnByServer(path)).toBe(expected);
});

test("a wrong password is said in place", async () => {
  serve((_, method) =>
    method === "POST"
      ? [403, { code: "session.wrong", message: "the name or the password is wrong", findings: [] }]
      : [200, { user: null, lab }],
  );
  show(<LoginPage />);
  await userEvent.type(screen.getByTestId("username"), "li");
  await userEvent.type(screen.getByTestId("password"), "no");
  await userEvent.click(screen.getByTestId("sign-in"));
  expect(await screen.findByText("The name or the password is wrong")).toBeInTheDocument();
});
