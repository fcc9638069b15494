/** Sign in, and go back to where one came from. */

import { useEffect, useState } from "react";
import { Navigate, useSearchParams } from "react-router";
import { useSignIn } from "@/api/commands";
import { useSession } from "@/api/queries";
import { Button, Refused, TextField } from "@/ui/controls";
import { Logo } from "@/ui/icons";
import { ModeChip } from "@/ui/state";
import { words } from "./words";

/** Only a path of this site may be gone back to. */
export function safeNext(next: string | null): string {
  return next && /^\/(?![/\\])/.test(next) && !next.startsWith("/login") ? next : "/";
}

/** Pages that the server draws itself: the router does not know them. */
export function isDrawnByServer(path: string): boolean {
  return /^\/(?:admin|api)(?:[/?#]|$)/.test(path);
}

/** Go to a page, with a whole load where the router does not know it. */
function GoTo({ path }: { path: string }) {
  const isOutside = isDrawnByServer(path);
  useEffect(() => {
    if (isOutside) window.location.replace(path);
  }, [isOutside, path]);
  return isOutside ? null : <Navigate to={path} replace />;
}

const RECENT = "labweb.recent-users";
const MOST_RECENT = 5;

/** Names that signed in on this terminal lately, the last one first. */
function recentNames(): string[] {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(RECENT) ?? "[]");
    return Array.isArray(kept) ? kept.filter((one) => typeof one === "string") : [];
  } catch {
    return [];
  }
}

function keepName(name: string): void {
  const names = [name, ...recentNames().filter((one) => one !== name)];
  localStorage.setItem(RECENT, JSON.stringify(names.slice(0, MOST_RECENT)));
}

/** Those who signed in on this terminal lately: one press, and only the password is missing. */
function RecentNames({ onPick }: { onPick: (name: string) => void }) {
  const [recent] = useState(recentNames);
  if (recent.length === 0) return null;
  return (
    <div className="acts" role="group" aria-label={words.password.recent}>
      {recent.map((name) => (
        <Button
          key={name}
          testId="recent-user"
          onClick={() => {
            onPick(name);
            document.querySelector<HTMLInputElement>("[data-testid=password]")?.focus();
          }}
        >
          {name}
        </Button>
      ))}
    </div>
  );
}

export function LoginPage() {
  const [params] = useSearchParams();
  const [username, setUsername] = useState("");
  const [password, setPassword] = useState("");
  const session = useSession();
  const signIn = useSignIn();
  if (session.data?.user) return <GoTo path={safeNext(params.get("next"))} />;
  const lab = session.data?.lab;
  return (
    <main className="login">
      <form
        className="card"
        onSubmit={(event) => {
          event.preventDefault();
          signIn.mutate({ username, password }, { onSuccess: () => keepName(username) });
        }}
      >
        <div className="login-head">
          <Logo />
          <h1>{lab?.name ?? "labweb"}</h1>
          <i className="sp" />
          {lab && <ModeChip mode={lab.mode} />}
        </div>
        {params.get("next") && <p className="s">Sign in to go on where you were.</p>}
        <RecentNames onPick={setUsername} />
        <TextField
          label="User name"
          value={username}
          onChange={setUsername}
          autoComplete="username"
          testId="username"
        />
        <TextField
          label="Password"
          type="password"
          value={password}
          onChange={setPassword}
          autoComplete="current-password"
          testId="password"
        />
        <Refused error={signIn.error} />
        <Button
          type="submit"
          look="pri"
          large
          testId="sign-in"
          disabled={signIn.isPending || !username || !password}
        >
          {signIn.isPending ? "Signing in…" : "Sign in"}
        </Button>
      </form>
    </main>
  );
}
