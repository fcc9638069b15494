/** What pages read of kept files. */

import { keepPreviousData, useQuery, type UseQueryResult } from "@tanstack/react-query";
import type { Drawn, FileDetail, FileRow, IncomingFile } from "@/model/wirefiles";
import { call } from "./client";
import { keys } from "./keys";

export interface About {
  resource: string | null;
  device: string | null;
  job: string | null;
}

function queryOf(about: About, limit: number): string {
  const told = Object.entries(about).flatMap(([name, id]) => (id ? [[name, id as string]] : []));
  const all = [...(told as [string, string][]), ["limit", String(limit)]];
  return new URLSearchParams(all).toString();
}

export function useFiles(about: About): UseQueryResult<FileRow[]> {
  const query = queryOf(about, 200);
  return useQuery({
    queryKey: keys.fileList(query),
    queryFn: ({ signal }) =>
      call<{ files: FileRow[] }>("GET", `/files?${query}`, undefined, signal),
    select: (answer: { files: FileRow[] }) => answer.files,
    placeholderData: keepPreviousData,
  });
}

/** What waits to be read or was refused; asked for again while something waits. */
export function useIncoming(about: About): UseQueryResult<IncomingFile[]> {
  const query = queryOf(about, 20);
  return useQuery({
    queryKey: keys.incoming(query),
    queryFn: ({ signal }) =>
      call<{ incoming: IncomingFile[] }>("GET", `/files/incoming?${query}`, undefined, signal),
    select: (answer: { incoming: IncomingFile[] }) => answer.incoming,
    refetchInterval: ({ state }) =>
      state.data?.incoming.some((row) => row.state === "pending" || row.state === "awaited")
        ? 1000
        : false,
  });
}

export function useFile(id: string): UseQueryResult<FileDetail> {
  return useQuery({
    queryKey: keys.file(id),
    queryFn: ({ signal }) => call<FileDetail>("GET", `/files/${id}`, undefined, signal),
    retry: false,
  });
}

/** Points never change: a kept file is never edited. */
export function usePoints(readingId: string, scan: number | null): UseQueryResult<Drawn> {
  const query = scan === null ? "" : `&scan=${scan}`;
  return useQuery({
    queryKey: keys.points(readingId, scan),
    queryFn: ({ signal }) =>
      call<Drawn>("GET", `/readings/${readingId}/points?points=2000${query}`, undefined, signal),
    staleTime: Infinity,
    retry: false,
  });
}

export const contentPath = (id: string): string => `/api/v1/files/${id}/content`;
