/** Cards, and what they show while there is nothing to show. */

import type { ReactNode } from "react";
import { useIsSlow } from "./pagestate";
import { useLabTime } from "./time";

interface CardProps {
  title: ReactNode;
  note?: ReactNode;
  actions?: ReactNode;
  children: ReactNode;
  className?: string;
  label?: string;
  testId?: string;
}

export function Card({ title, note, actions, children, className = "", label, testId }: CardProps) {
  return (
    <section className={`card ${className}`} aria-label={label} data-testid={testId}>
      <div className="ch">
        <h2>{title}</h2>
        {note && <span className="t12">{note}</span>}
        <i className="sp" />
        {actions}
      </div>
      {children}
    </section>
  );
}

/** What a query tells of itself; any query of the cache has this shape. */
export interface Source<T> {
  data: T | undefined;
  error: Error | null;
  isPending: boolean;
  dataUpdatedAt: number;
  refetch: () => unknown;
}

/** Loading, failed, or the data; failed with old data keeps it and says from when it is. */
export function Loaded<T>(props: {
  source: Source<T>;
  what: string;
  children: (data: T) => ReactNode;
}) {
  const { source, what } = props;
  if (source.data !== undefined) {
    return (
      <>
        {source.error && <AsOf at={source.dataUpdatedAt} why={source.error.message} />}
        {props.children(source.data)}
      </>
    );
  }
  if (source.error) return <Failed what={what} error={source.error} retry={source.refetch} />;
  return <Loading what={what} retry={source.refetch} />;
}

function Loading({ what, retry }: { what: string; retry: () => unknown }) {
  const isSlow = useIsSlow(true);
  return (
    <div className="state-note" data-testid="loading" aria-busy="true">
      Loading {what}…
      {isSlow && (
        <>
          <span role="status">The server has not answered yet.</span>
          <button className="btn" type="button" onClick={() => void retry()}>
            Try again
          </button>
        </>
      )}
    </div>
  );
}

export function Failed(props: { what: string; error: Error; retry?: () => unknown }) {
  return (
    <div className="state-note" role="alert" data-testid="failed">
      <span className="help bad">
        Cannot load {props.what}: {props.error.message}
      </span>
      {props.retry && (
        <button className="btn" type="button" onClick={() => props.retry?.()}>
          Try again
        </button>
      )}
    </div>
  );
}

export function AsOf({ at, why }: { at: number; why: string }) {
  const time = useLabTime();
  return (
    <p className="as-of t12" role="status" data-testid="as-of">
      As of <span className="num">{time.second(at / 1000)}</span>. {why}
    </p>
  );
}

export function Empty({ children }: { children: ReactNode }) {
  return (
    <div className="state-note" data-testid="empty">
      {children}
    </div>
  );
}
