// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import { expect, test } from "vitest";
import { serve, show } from "@/testpage";
import { WorkflowsPage } from "./workflows";

function page(permissions: string[]) {
  const user = { username: "somebody", permissions };
  serve((path) => [200, path === "/session" ? { user, lab: null } : { workflows: [] }]);
  show(<WorkflowsPage />, "/workflows?new=1");
}

test("an address that asks for a new workflow opens nothing for who may not draw", async () => {
  page(["view"]);
  await screen.findAllByText(/No workflow yet/);
  expect(screen.getByTestId("new-workflow")).toBeDisabled();
  expect(screen.queryByTestId("new-workflow-name")).toBeNull();
});

test("the same address asks who may draw for a name", async () => {
  page(["view", "draw"]);
  expect(await screen.findByTestId("new-workflow-name")).toBeInTheDocument();
});
