/** Lists that the server gives page by page. */

import {
  keepPreviousData,
  useInfiniteQuery,
  type InfiniteData,
  type UseInfiniteQueryResult,
} from "@tanstack/react-query";
import { call } from "./client";

type Page<T> = Record<string, T[]> & { next?: string | null };

const ROWS = 100;

async function page<T>(path: string, after: string, signal: AbortSignal): Promise<Page<T>> {
  const told = after ? `after=${encodeURIComponent(after)}` : "";
  const whole = told ? `${path}${path.includes("?") ? "&" : "?"}${told}` : path;
  return call<Page<T>>("GET", whole, undefined, signal);
}

/** Read a list to its end, for what is shown or searched as a whole. */
export const every =
  <T>(path: string, name: string) =>
  async ({ signal }: { signal: AbortSignal }): Promise<T[]> => {
    const rows: T[] = [];
    for (let after: string | null = ""; after !== null;) {
      const found: Page<T> = await page<T>(path, after, signal);
      rows.push(...(found[name] ?? []));
      after = found.next ?? null;
    }
    return rows;
  };

export type Listed<T> = UseInfiniteQueryResult<T[]>;

interface Asked<T> {
  queryKey: readonly unknown[];
  path: string;
  /** Under which name the answer holds the rows. */
  name: string;
  refetchInterval?: number | ((rows: T[]) => number | false);
  enabled?: boolean;
}

/** A list of which one page is read first, and each further one when a person asks for it. */
export function useListed<T>({ path, name, refetchInterval, ...asked }: Asked<T>): Listed<T> {
  const rowsOf = (found: InfiniteData<Page<T>, string> | undefined): T[] =>
    found?.pages.flatMap((one) => one[name] ?? []) ?? [];
  const from = `${path}${path.includes("?") ? "&" : "?"}limit=${ROWS}`;
  return useInfiniteQuery({
    ...asked,
    queryFn: ({ pageParam, signal }) => page<T>(from, pageParam, signal),
    initialPageParam: "",
    getNextPageParam: (last: Page<T>) => last.next ?? undefined,
    select: rowsOf,
    refetchInterval:
      typeof refetchInterval === "function"
        ? ({ state }) => refetchInterval(rowsOf(state.data))
        : refetchInterval,
    placeholderData: keepPreviousData,
  });
}
