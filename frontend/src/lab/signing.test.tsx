// @vitest-environment jsdom
import { fireEvent, screen, waitFor } from "@testing-library/react";
import { Route, Routes } from "react-router";
import { afterEach, describe, expect, it, vi } from "vitest";
import { call } from "@/api/client";
import { useSigning } from "@/api/signing";
import type { User } from "@/model/wire";
import { serve, show } from "@/testpage";
import { PasswordPage, SigningDialog } from "./signing";

const user: User = {
  id: "1",
  username: "ada",
  name: "Ada Lovelace",
  initials: "AL",
  roles: ["approver"],
  permissions: [],
  lab_permissions: [],
  password_from: "own",
};

const REFUSED = { code: "session.confirm", message: "type your password again", findings: [] };

afterEach(() => {
  vi.unstubAllGlobals();
  useSigning.setState({ answer: null });
});

describe("an act that is signed", () => {
  it("asks for the password, and is then sent again with the same key", async () => {
    let isSigned = false;
    const keys: string[] = [];
    serve(() => [200, {}]);
    const inner = fetch;
    vi.stubGlobal("fetch", (path: string, init: RequestInit) => {
      if (path.endsWith("/session/confirm")) isSigned = true;
      else keys.push(new Headers(init.headers).get("Idempotency-Key") ?? "");
      if (path.endsWith("/decision") && !isSigned)
        return Promise.resolve(new Response(JSON.stringify(REFUSED), { status: 403 }));
      return inner(path, init);
    });
    show(<SigningDialog user={user} />);
    const done = call("POST", "/approvals/1/decision", { is_approved: true });
    const field = await screen.findByTestId("signing-password");
    expect(screen.getByText(/Ada Lovelace/)).toBeTruthy();
    fireEvent.change(field, { target: { value: "secret" } });
    fireEvent.click(screen.getByTestId("signing-send"));
    await expect(done).resolves.toEqual({});
    expect(keys).toHaveLength(2);
    expect(new Set(keys).size).toBe(1);
    await waitFor(() => expect(screen.queryByTestId("signing-form")).toBeNull());
  });

  it("is refused when the person gives up", async () => {
    serve(() => [403, REFUSED]);
    show(<SigningDialog user={user} />);
    const done = call("POST", "/approvals/2/decision", {});
    const refused = expect(done).rejects.toThrow("Type your password again");
    fireEvent.click(await screen.findByText("Cancel"));
    await refused;
  });

  it("says that the password was wrong, and asks on", async () => {
    serve((path) =>
      path === "/session/confirm"
        ? [403, { code: "session.wrong", message: "the password is wrong", findings: [] }]
        : [403, REFUSED],
    );
    show(<SigningDialog user={user} />);
    const done = call("POST", "/approvals/3/decision", {}).catch(() => "given up");
    fireEvent.change(await screen.findByTestId("signing-password"), { target: { value: "x" } });
    fireEvent.click(screen.getByTestId("signing-send"));
    expect((await screen.findByTestId("refused")).textContent).toContain("password is wrong");
    fireEvent.click(screen.getByText("Cancel"));
    await expect(done).resolves.toBe("given up");
  });
});

describe("the page of the password", () => {
  const page = (
    <Routes>
      <Route path="/password" element={<PasswordPage />} />
      <Route path="/login" element={<p>Signed out</p>} />
    </Routes>
  );
  const answer = (password_from: string) => (path: string, method: string) =>
    (path === "/session" && method === "GET"
      ? [200, { user: { ...user, password_from }, lab: null }]
      : [204, null]) as [number, unknown];

  it("leads home for who need not change it", async () => {
    serve(answer("own"));
    show(page, "/password");
    expect(await screen.findByRole("link", { name: "Cancel" })).toHaveAttribute("href", "/");
    expect(screen.queryByRole("button", { name: "Sign out" })).toBeNull();
  });

  it("lets out who must change it and will not now", async () => {
    const sent = serve(answer("admin"));
    show(page, "/password");
    fireEvent.click(await screen.findByRole("button", { name: "Sign out" }));
    expect(await screen.findByText("Signed out")).toBeVisible();
    expect(sent.filter((one) => one.method === "DELETE")).toHaveLength(1);
    expect(screen.queryByRole("link", { name: "Cancel" })).toBeNull();
  });
});
