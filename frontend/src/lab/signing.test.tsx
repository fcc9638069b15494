// @vitest-environment jsdom
import { fireEvent, screen, waitFor } from "@testing-library/react";
import { afterEach, describe, expect, it, vi } from "vitest";
import { call } from "@/api/client";
import { useSigning } from "@/api/signing";
import type { User } from "@/model/wire";
import { serve, show } from "@/testpage";
import { SigningDialog } from "./signing";

const user: User = {
  id: 1,
  username: "ada",
  name: "Ada Lovelace",
  initials: "AL",
  roles: ["approver"],
  permissions: [],
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
