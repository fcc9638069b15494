/** The end of a list that goes on: how much of it is shown, and the way to more. */

import { Button } from "./controls";

/** What a list tells of itself that is read page by page. */
interface Listed<T> {
  data: T[] | undefined;
  error: Error | null;
  hasNextPage: boolean;
  isFetchingNextPage: boolean;
  isFetchNextPageError: boolean;
  fetchNextPage: () => unknown;
}

/** How many rows are here, `100+` where there are more. */
export const countOf = <T,>(list: Listed<T>): string | null =>
  list.data ? `${list.data.length}${list.hasNextPage ? "+" : ""}` : null;

/** @param what - In the plural, "runs". */
export function More<T>({ list, what }: { list: Listed<T>; what: string }) {
  if (!list.data || !list.hasNextPage) return null;
  return (
    <MoreOf
      count={list.data.length}
      what={what}
      isBusy={list.isFetchingNextPage}
      error={list.isFetchNextPageError ? list.error : null}
      onMore={() => void list.fetchNextPage()}
    />
  );
}

export function MoreOf(props: {
  count: number;
  what: string;
  isBusy: boolean;
  error: Error | null;
  onMore: () => void;
}) {
  const { what } = props;
  return (
    <div className="more" data-testid="more">
      <span className="m t12">
        The newest <span className="num">{props.count}</span> {what} are shown.
      </span>
      {props.error && (
        <span className="help bad" role="alert">
          Cannot load more {what}: {props.error.message}
        </span>
      )}
      <Button testId="show-more" disabled={props.isBusy} onClick={props.onMore}>
        {props.isBusy ? "Loading…" : `Show more ${what}`}
      </Button>
    </div>
  );
}
