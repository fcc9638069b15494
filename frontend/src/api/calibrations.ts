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

function refresh(): void {
  void client.invalidateQueries({ queryKey: keys.devices });
  void client.invalidateQueries({ queryKey: keys.runs });
}

/** By quantity; asked for again each few seconds while one is being measured. */
export function useCalibrations(deviceId: string): UseQueryResult<CalibratedQuantity[]> {
  return useQuery({
    queryKey: keys.calibrations(deviceId),
    queryFn: ({ signal }) =>
      call<{ quantities: CalibratedQuantity[] }>(
        "GET",
        `/devices/${deviceId}/calibrations`,
        undefined,
        signal,
      ),
    select: (answer: { quantities: CalibratedQuantity[] }) => answer.quantities,
    refetchInterval: ({ state }) =>
      state.data?.quantities.some((one) => one.history.some((row) => row.state === "measuring"))
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
