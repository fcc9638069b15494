/** Who may see the pages: somebody signed in, in a lab that exists. */

import { Navigate, useLocation } from "react-router";
import { useSignOut } from "@/api/commands";
import { useStream } from "@/api/live";
import { useSession } from "@/api/queries";
import { Failed } from "@/ui/card";
import { Button } from "@/ui/controls";
import { LabTimeProvider } from "@/ui/time";
import { Shell } from "./shell";
import { words } from "./words";

export function Frame() {
  const session = useSession();
  const { pathname, search } = useLocation();
  const signOut = useSignOut();
  const user = session.data?.user ?? null;
  useStream(user !== null);
  if (!session.data) {
    return (
      <main className="login">
        {session.error ? (
          <div className="card">
            <Failed what="the session" error={session.error} retry={session.refetch} />
          </div>
        ) : (
          <p className="m">Loading…</p>
        )}
      </main>
    );
  }
  if (!user) {
    const here = encodeURIComponent(pathname + search);
    return <Navigate to={pathname === "/" ? "/login" : `/login?next=${here}`} replace />;
  }
  if (user.password_from === "admin") return <Navigate to="/password" replace />;
  if (user.roles.length === 0) {
    return (
      <main className="login">
        <div className="card state-note">
          <h1>{words.noRole.title}</h1>
          <p className="s">{words.noRole.about(user.name)}</p>
          <Button onClick={() => signOut.mutate()}>{words.noRole.signOut}</Button>
        </div>
      </main>
    );
  }
  const { lab } = session.data;
  if (!lab) {
    return (
      <main className="login">
        <div className="card state-note">
          <h1>No lab yet</h1>
          <p className="s">Start the server with a lab file, or import one in Admin.</p>
          <a className="btn" href="/admin/">
            Admin
          </a>
        </div>
      </main>
    );
  }
  return (
    <LabTimeProvider zone={lab.time_zone}>
      <Shell lab={lab} user={user} />
    </LabTimeProvider>
  );
}
