/** Drivers: what pages read and write of them. */

import {
  useMutation,
  useQueries,
  useQuery,
  type UseMutationResult,
  type UseQueryOptions,
  type UseQueryResult,
} from "@tanstack/react-query";
import { isChanging } from "@/model/drivers";
import type {
  DriverDetail,
  DriverReading,
  DriverRow,
  DriverUse,
  ModuleChange,
  PartChanges,
} from "@/model/wiredrivers";
import { useAct } from "./act";
import { call } from "./client";
import { keys } from "./keys";
import { client } from "./live";
import { every } from "./pages";

function refreshDrivers(): void {
  void client.invalidateQueries({ queryKey: keys.drivers });
  void client.invalidateQueries({ queryKey: keys.devices });
  void client.invalidateQueries({ queryKey: keys.home });
  void client.invalidateQueries({ queryKey: keys.session });
}

export function useDrivers(): UseQueryResult<DriverRow[]> {
  return useQuery({
    queryKey: keys.driverList,
    queryFn: every<DriverRow>("/drivers", "drivers"),
    refetchInterval: 30_000,
  });
}

/** One version; asked for again each second while a device changes to or from it. */
export function useDriver(id: string): UseQueryResult<DriverDetail> {
  return useQuery({
    queryKey: keys.driver(id),
    queryFn: ({ signal }) => call<DriverDetail>("GET", `/drivers/${id}`, undefined, signal),
    retry: false,
    refetchInterval: ({ state }) => (state.data && isChanging(state.data.places) ? 1000 : 30_000),
  });
}

/** What differs between two versions; neither is ever edited. */
export function useDriverChanges(id: string, since: string | null): UseQueryResult<ModuleChange[]> {
  return useQuery({
    queryKey: keys.driverChanges(id, since ?? ""),
    queryFn: ({ signal }) =>
      call<{ modules: ModuleChange[] }>(
        "GET",
        `/drivers/${id}/changes/${since ?? ""}`,
        undefined,
        signal,
      ),
    select: (answer: { modules: ModuleChange[] }) => answer.modules,
    enabled: since !== null,
    staleTime: Infinity,
    retry: false,
  });
}

export interface Source {
  module: string;
  source: string;
}

/** Have source read as text. Nothing is kept, so the newest source is read at once. */
export function useReadDriver(): UseMutationResult<DriverReading, Error, Source> {
  return useMutation({
    mutationFn: (given) => call<DriverReading>("POST", "/drivers/reading", given),
  });
}

export function useProposeDriver(): UseMutationResult<DriverRow, Error, Source & { note: string }> {
  return useAct({
    mutationFn: (given) => call<DriverRow>("POST", "/drivers", given),
    onSuccess: refreshDrivers,
  });
}

export function useDecideDriver(
  id: string,
): UseMutationResult<DriverRow, Error, { is_approved: boolean; comment: string }> {
  return useAct({
    mutationFn: (decision) => call<DriverRow>("POST", `/drivers/${id}/decision`, decision),
    onSettled: refreshDrivers,
  });
}

export function useWithdrawDriver(id: string): UseMutationResult<DriverRow, Error, string> {
  return useAct({
    mutationFn: (reason) => call<DriverRow>("POST", `/drivers/${id}/withdraw`, { reason }),
    onSettled: refreshDrivers,
  });
}

/** Which parts come and go when a device gets a version, and what speaks against it now. */
export function usePartChanges(deviceId: string, versionId: string): UseQueryResult<PartChanges> {
  return useQuery(partChanges(deviceId, versionId));
}

function partChanges(deviceId: string, versionId: string): UseQueryOptions<PartChanges> {
  return {
    queryKey: keys.driverParts(deviceId, versionId),
    queryFn: ({ signal }) =>
      call<PartChanges>("GET", `/devices/${deviceId}/driver/${versionId}/parts`, undefined, signal),
    enabled: versionId !== "",
    refetchOnMount: "always",
    retry: false,
  };
}

/** The same for several devices, in their order. */
export function usePartChangesOf(
  deviceIds: string[],
  versionId: string,
): UseQueryResult<PartChanges>[] {
  return useQueries({ queries: deviceIds.map((id) => partChanges(id, versionId)) });
}

/** Give several devices a version: all of them, or none. */
export function useGiveDriverToMany(
  versionId: string,
): UseMutationResult<unknown, Error, { devices: { device_id: string }[]; reason: string }> {
  return useAct({
    mutationFn: (choices) => call("POST", `/drivers/${versionId}/devices`, choices),
    onSettled: refreshDrivers,
  });
}

/** Give a device a version; its present one takes back what is staged. */
export function useGiveDriver(
  deviceId: string,
): UseMutationResult<DriverUse, Error, { version_id: string; reason: string; parts?: string }> {
  return useAct({
    mutationFn: (choice) => call<DriverUse>("POST", `/devices/${deviceId}/driver`, choice),
    onSettled: refreshDrivers,
  });
}
