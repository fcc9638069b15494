/** There is no such page, or a page failed: what happened, and the ways out. */

import { Component, type ReactNode } from "react";
import { Link, useLocation, useRouteError } from "react-router";
import { useIsSlow, wayBack } from "./pagestate";

export function NotFoundPage() {
  const { pathname } = useLocation();
  const { to, all } = wayBack(pathname);
  return (
    <div className="wrap" data-testid="not-found">
      <div className="card state-note">
        <h1>There is no such page</h1>
        <p className="s">The address may be old, or the thing it names was removed.</p>
        {to !== "/" && (
          <Link className="btn" to={to}>
            {all}
          </Link>
        )}
        <Link className="btn" to="/">
          Show the home page
        </Link>
      </div>
    </div>
  );
}

/** A page of the router failed. */
export function BrokenPage() {
  const error = useRouteError();
  const { pathname } = useLocation();
  return <Broken error={error} pathname={pathname} />;
}

/** Whatever fails outside of the router. */
export class Boundary extends Component<{ children: ReactNode }, { error: unknown }> {
  override state = { error: null as unknown };

  static getDerivedStateFromError(error: unknown): { error: unknown } {
    return { error: error ?? new Error("It did not say why.") };
  }

  override render(): ReactNode {
    if (this.state.error === null) return this.props.children;
    return <Broken error={this.state.error} pathname={window.location.pathname} />;
  }
}

/** While the first page is fetched; what takes long says so. */
export function Starting() {
  const isSlow = useIsSlow(true);
  return (
    <main className="login">
      <div className="state-note" aria-busy="true" data-testid="starting">
        <span className="m">Loading…</span>
        {isSlow && (
          <>
            <span role="status">The server has not answered yet.</span>
            <TryAgain />
          </>
        )}
      </div>
    </main>
  );
}

/** The ways out load the page anew, so that nothing of what failed is kept. */
function Broken({ error, pathname }: { error: unknown; pathname: string }) {
  const { to, all } = wayBack(pathname);
  return (
    <div className="wrap" role="alert" data-testid="broken">
      <div className="card state-note">
        <h1>This page failed</h1>
        <p className="s">{reasonOf(error)}</p>
        <p className="s">
          The lab is not affected: what runs goes on. What you drew and did not save is kept in this
          tab.
        </p>
        <TryAgain />
        <a className="btn" href={to}>
          {all}
        </a>
        {to !== "/" && (
          <a className="btn" href="/">
            Show the home page
          </a>
        )}
      </div>
    </div>
  );
}

function TryAgain() {
  return (
    <button type="button" className="btn" onClick={() => window.location.reload()}>
      Try again
    </button>
  );
}

const PART_MISSING = /dynamically imported module|module script|Unable to preload|ChunkLoad/i;

function reasonOf(error: unknown): string {
  if (!(error instanceof Error) || !error.message) return "It did not say why.";
  if (PART_MISSING.test(error.message))
    return "A part of the page could not be fetched: the server does not answer, or it was updated.";
  return `It met something that it cannot show: ${error.message}`;
}
