/** There is no such page, or a page failed. */

import { Link, useRouteError } from "react-router";

export function NotFoundPage() {
  return (
    <div className="wrap" data-testid="not-found">
      <div className="card state-note">
        <h1>There is no such page</h1>
        <p className="s">The address may be old, or the thing it names was removed.</p>
        <Link className="btn" to="/">
          Home
        </Link>
      </div>
    </div>
  );
}

export function BrokenPage() {
  const error = useRouteError();
  return (
    <div className="wrap" role="alert">
      <div className="card state-note">
        <h1>This page failed</h1>
        <p className="s">{error instanceof Error ? error.message : "It did not say why."}</p>
        <p className="s">The lab is not affected. Stop lab works from every other page.</p>
        <button type="button" className="btn" onClick={() => window.location.reload()}>
          Load again
        </button>
      </div>
    </div>
  );
}
