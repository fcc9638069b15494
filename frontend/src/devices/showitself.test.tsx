// @vitest-environment jsdom
import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import type { Device } from "@/model/wire";
import { serve, show } from "@/testpage";
import { ShowItself } from "./showitself";

const device = {
  id: "d1",
  link: "online",
  shows_itself: true,
  actions: [{ name: "show_itself", doc: "Let the lights blink for a while." }],
} as Device;

function session(permissions: string[]): object {
  return { user: { username: "x", printed_name: "X", permissions } };
}

test("a device is asked to show its name, and the run is named", async () => {
  const sent = serve((path) =>
    path === "/session" ? [200, session(["run"])] : [201, { run_id: "r1", number: 7 }],
  );
  show(<ShowItself device={device} />);
  await waitFor(() => expect(screen.getByTestId("show-name")).toBeEnabled());
  expect(screen.getByTestId("show-itself")).toHaveTextContent(
    "Let the lights blink for a while. It takes 20 s, and nothing moves.",
  );
  await userEvent.click(screen.getByTestId("show-name"));
  expect(await screen.findByRole("link", { name: /Run #7/ })).toHaveAttribute("href", "/runs/r1");
  expect(sent.some((one) => one.method === "POST" && one.path.endsWith("/devices/d1/show"))).toBe(
    true,
  );
});

test("who may not run anything, or whose device is away, reads why", async () => {
  serve(() => [200, session([])]);
  const { unmount } = show(<ShowItself device={device} />);
  expect(screen.getByTestId("show-name")).toBeDisabled();
  unmount();
  serve(() => [200, session(["run"])]);
  show(<ShowItself device={{ ...device, link: "offline" } as Device} />);
  expect(screen.getByTestId("show-name")).toBeDisabled();
});

test("a device that shows nothing has no such card", () => {
  serve(() => [200, session(["run"])]);
  show(<ShowItself device={{ ...device, shows_itself: false }} />);
  expect(screen.queryByTestId("show-itself")).toBeNull();
});
