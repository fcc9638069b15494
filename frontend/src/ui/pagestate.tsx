/** What a page shows in the place of its thing: it loads, is missing, or cannot be had; always with a way out. */

import { useEffect, useState } from "react";
import { Link } from "react-router";

/** How one thing is called, and where all of its kind are. */
const KINDS = {
  workflow: { to: "/workflows", all: "Show all workflows" },
  run: { to: "/runs", all: "Show all runs" },
  device: { to: "/devices", all: "Show all devices" },
  host: { to: "/devices", all: "Show all devices and hosts" },
  driver: { to: "/drivers", all: "Show all drivers" },
  tryout: { to: "/drivers", all: "Show all drivers" },
  file: { to: "/files", all: "Show all files" },
  request: { to: "/approvals", all: "Show all requests" },
  resource: { to: "/lab", all: "Show the lab" },
} as const;

export type Kind = keyof typeof KINDS;

/** After this a page that still loads says so, and offers the ways out. */
export const SLOW_MS = 8000;

const isMissing = (error: Error): boolean => (error as Error & { status?: number }).status === 404;

/** The page of one thing that is not there yet, or at all. */
export function PageState(props: { of: Kind; error: Error | null; retry: () => unknown }) {
  return (
    <div className="wrap">
      <div className="card">
        <PartState {...props} />
      </div>
    </div>
  );
}

/** The same within a page that shows other things, too. */
export function PartState(props: { of: Kind; error: Error | null; retry: () => unknown }) {
  const { of, error, retry } = props;
  const isSlow = useIsSlow(error === null);
  const ways = <Ways of={of} retry={retry} />;
  if (error && isMissing(error)) {
    return (
      <div className="state-note" role="alert" data-testid="missing">
        <span>This {of} does not exist, or you may not see it.</span>
        <Link className="btn" to={KINDS[of].to}>
          {KINDS[of].all}
        </Link>
      </div>
    );
  }
  if (error) {
    return (
      <div className="state-note" role="alert" data-testid="failed">
        <span className="help bad">
          Cannot load this {of}: {error.message}
        </span>
        {ways}
      </div>
    );
  }
  return (
    <div className="state-note" data-testid="loading" aria-busy="true">
      <span className="m">Loading the {of}…</span>
      {isSlow && (
        <>
          <span role="status">The server has not answered yet.</span>
          {ways}
        </>
      )}
    </div>
  );
}

function Ways({ of, retry }: { of: Kind; retry: () => unknown }) {
  return (
    <>
      <button className="btn" type="button" onClick={() => void retry()}>
        Try again
      </button>
      <Link className="btn" to={KINDS[of].to}>
        {KINDS[of].all}
      </Link>
    </>
  );
}

/** Whether something has gone on for longer than people wait without a word. */
export function useIsSlow(isGoingOn: boolean, afterMs = SLOW_MS): boolean {
  const [isSlow, setSlow] = useState(false);
  useEffect(() => {
    if (!isGoingOn) return;
    const timer = setTimeout(() => setSlow(true), afterMs);
    return () => {
      clearTimeout(timer);
      setSlow(false);
    };
  }, [isGoingOn, afterMs]);
  return isGoingOn && isSlow;
}

/** All of a kind, for an address below it; home for any other. */
export function wayBack(pathname: string): { to: string; all: string } {
  const kinds = Object.values(KINDS).filter(({ to }) => pathname.startsWith(`${to}/`));
  const part = pathname.split("/")[1];
  if (part === "hosts") return KINDS.host;
  if (part === "lineage") return KINDS.resource;
  return kinds[0] ?? { to: "/", all: "Show the home page" };
}
