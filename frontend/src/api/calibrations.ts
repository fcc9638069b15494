/** Calibrations of a device: what its page reads and writes of them. */

import { useQuery, type UseMutationResult, type UseQueryResult } from "@tanstack/react-query";
import type {
  CalibratedQuantity,
  Calibration,
  PhOrder,
  TemperatureOrder,
  VolumeOrder,
} from "@/model/wirecalibration";
import { useAct } from "./act";
import { call } from "./client";
import { keys } from "./keys";
import { client } from "./live";
import { every } from "./pages";

function refresh(): void {
  void client.invalidateQueries({ queryKey: keys.devices });
  void client.invalidateQueries({ queryKey: keys.runs });
}

/** Each page of the answer has every quantity, with its part of the history. */
function together(pages: CalibratedQuantity[]): CalibratedQuantity[] {
  const found = new Map<string, CalibratedQuantity>();
  for (const one of pages) {
    const before = found.get(one.quantity)?.history ?? [];
    found.set(one.quantity, { ...one, history: [...before, ...one.history] });
  }
  return [...found.values()];
}

/** By quantity; asked for again each few seconds while one is being measured. */
export function useCalibrations(deviceId: string): UseQueryResult<CalibratedQuantity[]> {
  return useQuery({
    queryKey: keys.calibrations(deviceId),
    queryFn: every<CalibratedQuantity>(`/devices/${deviceId}/calibrations`, "quantities"),
    select: together,
    refetchInterval: ({ state }) =>
      state.data?.some((one) => one.history.some((row) => row.state === "measuring"))
        ? 3000
        : 60_000,
  });
}

export function useBeginCalibration(
  deviceId: string,
): UseMutationResult<Calibration, Error, VolumeOrder> {
  return useAct({
    mutationFn: (order) => call<Calibration>("POST", `/devices/${deviceId}/calibrations`, order),
    onSuccess: refresh,
  });
}

export function useBeginPhCalibration(
  deviceId: string,
): UseMutationResult<Calibration, Error, PhOrder> {
  return useAct({
    mutationFn: (order) => call<Calibration>("POST", `/devices/${deviceId}/calibrations/ph`, order),
    onSuccess: refresh,
  });
}

export function useBeginTemperatureCalibration(
  deviceId: string,
): UseMutationResult<Calibration, Error, TemperatureOrder> {
  return useAct({
    mutationFn: (order) =>
      call<Calibration>("POST", `/devices/${deviceId}/calibrations/temperature`, order),
    onSuccess: refresh,
  });
}

export function useWithdrawCalibration(id: string): UseMutationResult<Calibration, Error, string> {
  return useAct({
    mutationFn: (reason) => call<Calibration>("POST", `/calibrations/${id}/withdraw`, { reason }),
    onSuccess: refresh,
  });
}
