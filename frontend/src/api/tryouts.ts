/** Drivers on trial: what pages read of them and ask of them. */

import { useQuery, type UseMutationResult, type UseQueryResult } from "@tanstack/react-query";
import { isLive } from "@/model/tryouts";
import type { Tryout, TryoutAct, TryoutWanted, TryoutWish, Tryouts } from "@/model/wiretryouts";
import { useAct } from "./act";
import { call } from "./client";
import { keys } from "./keys";
import { client } from "./live";

/** Where a version can be tried, and what was tried of it. */
export function useTryouts(driverId: string): UseQueryResult<Tryouts> {
  return useQuery({
    queryKey: keys.tryouts(driverId),
    queryFn: ({ signal }) =>
      call<Tryouts>("GET", `/drivers/${driverId}/tryouts`, undefined, signal),
    refetchInterval: 10_000,
  });
}

/** One tryout; asked for again each second while it goes on, should a word of it be lost. */
export function useTryout(id: string | null): UseQueryResult<Tryout> {
  return useQuery({
    queryKey: keys.tryout(id ?? ""),
    queryFn: ({ signal }) => call<Tryout>("GET", `/tryouts/${id ?? ""}`, undefined, signal),
    enabled: id !== null,
    retry: false,
    refetchInterval: ({ state }) => (isLive(state.data) ? 1000 : false),
  });
}

export function useBeginTryout(driverId: string): UseMutationResult<Tryout, Error, TryoutWanted> {
  return useAct({
    mutationFn: (wanted) => call<Tryout>("POST", `/drivers/${driverId}/tryouts`, wanted),
    onSettled: () => void client.invalidateQueries({ queryKey: keys.tryouts(driverId) }),
  });
}

export function useWish(id: string): UseMutationResult<TryoutAct, Error, TryoutWish> {
  return useAct({
    mutationFn: (wish) => call<TryoutAct>("POST", `/tryouts/${id}/wishes`, wish),
    onSettled: () => void client.invalidateQueries({ queryKey: keys.tryout(id) }),
  });
}
