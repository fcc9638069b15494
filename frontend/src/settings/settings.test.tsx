// @vitest-environment jsdom
import { fireEvent, screen, waitFor } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";
import type { AccessToken } from "@/model/wiretokens";
import { serve, show } from "@/testpage";
import { SettingsPage } from "./page";

const token: AccessToken = {
  id: "t1",
  name: "nightly figures",
  owner: "Ada Lovelace",
  scope: "draft",
  created_at: "2026-01-01T10:00:00Z",
  expires_at: "2099-01-01T10:00:00Z",
  revoked_at: null,
  used_at: null,
  is_valid: true,
};

afterEach(() => vi.unstubAllGlobals());

it("shows the secret of a new token once, and then the token without it", async () => {
  const rows: AccessToken[] = [];
  const sent = serve((path, method) => {
    if (method === "POST") {
      rows.push(token);
      return [201, { token, secret: "labweb_secret" }];
    }
    return [200, path.includes("/tokens") ? { tokens: rows, next: null } : { user: null }];
  });
  show(<SettingsPage />);
  await screen.findByText("You have no access token.");
  fireEvent.click(screen.getByTestId("make-token"));
  const name = await screen.findByTestId("token-name");
  expect(screen.getByTestId("token-send")).toHaveProperty("disabled", true);
  fireEvent.change(name, { target: { value: "nightly figures" } });
  fireEvent.click(screen.getByText("Draft"));
  fireEvent.click(screen.getByText("90 days"));
  fireEvent.click(screen.getByTestId("token-send"));
  expect(await screen.findByTestId("token-secret")).toHaveProperty("value", "labweb_secret");
  const wanted = sent.find((one) => one.method === "POST");
  expect(wanted?.body).toEqual({ name: "nightly figures", scope: "draft", days: 90 });
  fireEvent.click(screen.getByTestId("token-done"));
  await screen.findByTestId("token-row");
  await waitFor(() => expect(screen.queryByDisplayValue("labweb_secret")).toBeNull());
});

it("revokes a token only after a second question", async () => {
  const asked: string[] = [];
  serve((path, method) => {
    if (method === "DELETE") asked.push(path);
    return [200, path.includes("/tokens") ? { tokens: [token], next: null } : { user: null }];
  });
  show(<SettingsPage />);
  fireEvent.click(await screen.findByTestId("token-revoke"));
  await screen.findByText(/can do nothing from now on/);
  expect(asked).toEqual([]);
  fireEvent.click(screen.getByTestId("token-revoke-send"));
  await waitFor(() => expect(asked).toHaveLength(1));
  expect(asked[0]).toContain("/tokens/t1");
});
