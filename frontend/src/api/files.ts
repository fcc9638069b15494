/** What pages read of kept files. */

import { useQuery, type UseQueryResult } from "@tanstack/react-query";
import type { Drawn, FileDetail, FileRow, IncomingFile } from "@/model/wirefiles";
import { call } from "./client";
import { keys } from "./keys";
import { useListed, type Listed } from "./pages";

export interface About {
  resource: string | null;
  device: string | null;
  job: string | null;
}

function queryOf(about: About): string {
  const told = Object.entries(about).flatMap(([name, id]) => (id ? [[name, id as string]] : []));
  return told.length ? `?${new URLSearchParams(told as [string, string][]).toString()}` : "";
}

export function useFiles(about: About): Listed<FileRow> {
  const query = queryOf(about);
  return useListed({ queryKey: keys.fileList(query), path: `/files${query}`, name: "files" });
}

/** What waits to be read or was refused; asked for again while something waits. */
export function useIncoming(about: About): Listed<IncomingFile> {
  const query = queryOf(about);
  return useListed<IncomingFile>({
    queryKey: keys.incoming(query),
    path: `/files/incoming${query}`,
    name: "incoming",
    refetchInterval: (rows) =>
      rows.some((row) => row.state === "pending" || row.state === "awaited") ? 1000 : false,
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
