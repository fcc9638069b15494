/** Curves of a device: what was kept, and what comes in. */

import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useState } from "react";
import { appendSamples, pairSeries, type Channel } from "@/model/telemetry";
import type { Curves } from "@/model/curves";
import type { Sample } from "@/model/wire";
import { call } from "./client";
import { keys } from "./keys";
import { listenTelemetry } from "./live";
import { useDevice } from "./queries";

type Series = Record<string, [number, unknown][]>;

/** Channels of a device between two times; with no end, up to now and growing. */
export function useChannels(
  deviceId: string,
  since_s: number,
  until_s: number | null,
): { channels: Channel[]; isPending: boolean; error: Error | null } {
  const device = useDevice(deviceId);
  const kept = useQuery({
    queryKey: [...keys.telemetry(deviceId), Math.floor(since_s / 60), until_s],
    queryFn: ({ signal }) => {
      const until = until_s === null ? "" : `&until_s=${until_s}`;
      const path = `/devices/${deviceId}/telemetry?since_s=${since_s}${until}`;
      return call<{ series: Series }>("GET", path, undefined, signal);
    },
    staleTime: 60_000,
    enabled: deviceId !== "",
  });
  const live = useLiveSamples(deviceId, until_s === null);
  const statuses = device.data?.statuses;
  const channels = useMemo(() => {
    const keep = Date.now() / 1000 - since_s + 60;
    const series = appendSamples(kept.data?.series ?? {}, live, keep);
    return pairSeries(series, statuses ?? []);
  }, [kept.data, live, since_s, statuses]);
  return { channels, isPending: kept.isPending, error: kept.error };
}

const POINTS = 800;

/** What a device told in a chosen time; of a span that ends now it is fetched again and again. */
export function useCurves(
  deviceId: string,
  range: { span_s: number; again_s: number } | { since_s: number; until_s: number },
) {
  return useQuery({
    queryKey: [...keys.telemetry(deviceId), "curves", range],
    queryFn: ({ signal }) => {
      const until = "span_s" in range ? Date.now() / 1000 : range.until_s;
      const since = "span_s" in range ? until - range.span_s : range.since_s;
      const asked = `since_s=${since}&until_s=${until}&points=${POINTS}`;
      const path = `/devices/${deviceId}/telemetry/curves?${asked}`;
      return call<Curves>("GET", path, undefined, signal);
    },
    refetchInterval: "span_s" in range ? range.again_s * 1000 : false,
    enabled: deviceId !== "",
  });
}

const MOST_LIVE = 20_000;

export function useLiveSamples(deviceId: string, isLive: boolean): Sample[] {
  const [samples, setSamples] = useState<Sample[]>([]);
  useEffect(() => {
    setSamples([]);
    if (!isLive || !deviceId) return;
    let waiting: Sample[] = [];
    let frame = 0;
    const end = listenTelemetry(deviceId, (came) => {
      waiting.push(...came);
      frame ||= requestAnimationFrame(() => {
        frame = 0;
        const due = waiting;
        waiting = [];
        setSamples((old) => [...old, ...due].slice(-MOST_LIVE));
      });
    });
    return () => {
      cancelAnimationFrame(frame);
      end();
    };
  }, [deviceId, isLive]);
  return samples;
}
