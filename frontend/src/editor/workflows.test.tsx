// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, test } from "vitest";
import { serve, show } from "@/testpage";
import { WorkflowsPage } from "./workflows";

function page(permissions: string[], workflows: unknown[] = [], onLab = permissions) {
  const user = { username: "somebody", permissions, lab_permissions: onLab };
  serve((path) => [200, path === "/session" ? { user, lab: null } : { workflows }]);
  show(<WorkflowsPage />, "/workflows?new=1");
}

test("an address that asks for a new workflow opens nothing for who may not draw", async () => {
  page(["view"]);
  await screen.findAllByText(/No workflow yet/);
  expect(screen.getByTestId("new-workflow")).toBeDisabled();
  expect(screen.queryByTestId("new-workflow-name")).toBeNull();
});

test("who may draw only in a part of the lab reads why not, and who can help", async () => {
  page(["view", "draw"], [], []);
  await screen.findAllByText(/No workflow yet/);
  const button = screen.getByTestId("new-workflow");
  expect(button).toBeDisabled();
  await userEvent.hover(button.parentElement ?? document.body);
  expect(await screen.findByText(/only in a part of it.*Ask an admin/)).toBeInTheDocument();
  expect(screen.queryByTestId("new-workflow-name")).toBeNull();
});

test("the same address asks who may draw for a name", async () => {
  page(["view", "draw"]);
  expect(await screen.findByTestId("new-workflow-name")).toBeInTheDocument();
});

test.each([
  ["answer", "in doubt, waits for an answer"],
  ["recovery", "waits for recovery"],
  [null, "paused"],
])("the last run that waits for %s says so: %s", async (waits_for, word) => {
  const last_run = { id: "r", number: 7, state: "paused", ended_at: null, waits_for };
  const row = { id: "w", name: "Move water", last_run, latest_version: null, steps_count: 1 };
  page(["view"], [{ ...row, description: "", is_template: false, updated_at: "2026-11-20" }]);
  expect(await screen.findByRole("link", { name: new RegExp(`^#7 ?${word}$`) })).toHaveAttribute(
    "href",
    "/runs/r",
  );
});
