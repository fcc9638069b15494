/** Whether the live stream and the server can be reached, and since when not. */

import { create } from "zustand";

export type Status = "connecting" | "live" | "reconnecting" | "offline";

interface Connection {
  isOpen: boolean;
  isReachable: boolean;
  hasBeenOpen: boolean;
  latencyMs: number | null;
  /** Seconds since 1970 when the stream broke. */
  lostAt: number | null;
  setOpen: (isOpen: boolean) => void;
  setReachable: (isReachable: boolean) => void;
  setLatency: (ms: number) => void;
}

export const useConnection = create<Connection>((set) => ({
  isOpen: false,
  isReachable: true,
  hasBeenOpen: false,
  latencyMs: null,
  lostAt: null,
  setOpen: (isOpen) =>
    set((state) => ({
      isOpen,
      hasBeenOpen: state.hasBeenOpen || isOpen,
      isReachable: isOpen || state.isReachable,
      lostAt: isOpen ? null : (state.lostAt ?? Date.now() / 1000),
      latencyMs: isOpen ? state.latencyMs : null,
    })),
  setReachable: (isReachable) =>
    set((state) => (state.isReachable === isReachable ? state : { isReachable })),
  setLatency: (latencyMs) => set({ latencyMs }),
}));

/** Status as the chip in the top bar says it. */
export function statusOf(
  state: Pick<Connection, "isOpen" | "isReachable" | "hasBeenOpen">,
): Status {
  if (state.isOpen) return "live";
  if (!state.isReachable) return "offline";
  return state.hasBeenOpen ? "reconnecting" : "connecting";
}

export function useStatus(): Status {
  return useConnection(statusOf);
}
