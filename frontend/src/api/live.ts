/** From the live stream to the cache: a topic moves, its queries are fetched again. */

import { QueryClient, type QueryKey } from "@tanstack/react-query";
import { useEffect } from "react";
import { UnreadableDocument } from "@/model/opening";
import type { Sample } from "@/model/wire";
import { ApiError, whenSignedOut } from "./client";
import { useConnection } from "./connection";
import { keys } from "./keys";
import { LiveSocket } from "./socket";

export const client = new QueryClient({
  defaultOptions: {
    queries: {
      networkMode: "always",
      staleTime: 2000,
      refetchOnWindowFocus: true,
      retry: (count, error) => count < 2 && isWorthAnother(error),
    },
    mutations: { networkMode: "always", retry: false },
  },
});

/** What was answered, or not for half a minute, or cannot be shown, is not asked for again unasked. */
function isWorthAnother(error: Error): boolean {
  if (error instanceof UnreadableDocument) return false;
  return !(error instanceof ApiError && (error.status > 0 || error.code === "http.timeout"));
}

const FIXED: Record<string, QueryKey[]> = {
  lab: [keys.session, keys.home],
  runs: [keys.runs, keys.home, keys.session],
  approvals: [keys.approvals, keys.home, keys.session],
  hosts: [keys.hosts, keys.home, ["custody"]],
  devices: [keys.devices, keys.drivers, keys.home, keys.starts],
  drivers: [keys.drivers, keys.home, keys.session],
  tryouts: [keys.everyTryout],
  events: [keys.resources, keys.starts],
  workflows: [keys.workflows, keys.home],
};

function keysOf(topic: string): QueryKey[] {
  if (topic.startsWith("run:")) return [keys.run(topic.slice(4))];
  if (topic.startsWith("telemetry:")) return [keys.telemetry(topic.slice(10))];
  return FIXED[topic] ?? [];
}

const WAIT_MS = 120;
const waiting = new Map<string, QueryKey>();
let timer: ReturnType<typeof setTimeout> | undefined;

/** Fetch again soon; many messages in one burst are one fetch. */
function refresh(list: QueryKey[]): void {
  for (const key of list) waiting.set(JSON.stringify(key), key);
  timer ??= setTimeout(() => {
    timer = undefined;
    const due = [...waiting.values()];
    waiting.clear();
    for (const queryKey of due) void client.invalidateQueries({ queryKey });
  }, WAIT_MS);
}

function socketUrl(): string {
  const { protocol, host } = window.location;
  return `${protocol === "https:" ? "wss" : "ws"}://${host}/ws/v1/`;
}

let shared: LiveSocket | undefined;

function socket(): LiveSocket {
  shared ??= new LiveSocket(socketUrl(), {
    onOpen: (isAgain) => {
      useConnection.getState().setOpen(true);
      if (isAgain) void client.invalidateQueries();
    },
    onClose: (code) => {
      useConnection.getState().setOpen(false);
      if (code === 4401) void client.invalidateQueries({ queryKey: keys.session });
      else void client.refetchQueries({ queryKey: keys.session, type: "active" });
    },
    onGap: (topic) => refresh(keysOf(topic)),
    onLatency: (ms) => useConnection.getState().setLatency(ms),
  });
  return shared;
}

/** Open the stream while somebody is signed in. */
export function useStream(isWanted: boolean): void {
  useEffect(() => {
    if (!isWanted) return;
    const live = socket();
    const hurry = (): void => live.hurry();
    live.start();
    window.addEventListener("online", hurry);
    return () => {
      window.removeEventListener("online", hurry);
      live.stop();
    };
  }, [isWanted]);
}

/** Keep the queries of these topics fresh while the caller is on the page. */
export function useTopics(...topics: string[]): void {
  const joined = topics.join(" ");
  useEffect(() => {
    const ends = joined
      .split(" ")
      .filter(Boolean)
      .map((topic) => socket().listen(topic, () => refresh(keysOf(topic))));
    return () => {
      for (const end of ends) end();
    };
  }, [joined]);
}

/** Hand each telemetry frame of a device to `onSamples`. */
export function listenTelemetry(
  deviceId: string,
  onSamples: (samples: Sample[]) => void,
): () => void {
  return socket().listen(`telemetry:${deviceId}`, (message) => {
    const samples = (message.data as { samples?: Sample[] } | null)?.samples;
    if (samples?.length) onSamples(samples);
  });
}

whenSignedOut(() => {
  client.setQueryData(keys.session, (old: { lab?: unknown } | undefined) => ({
    user: null,
    lab: old?.lab ?? null,
  }));
});
