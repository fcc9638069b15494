/** How a host stands: the word for its session, and what is worth a sentence. */

import { formatDuration } from "./format";
import { capitalise, isActiveJob, jobState, type State } from "./states";
import type { Host } from "./wire";

const SESSION: Record<string, State> = {
  enrolling: { look: "queued", word: "Not heard yet" },
  online: { look: "idle", word: "Online" },
  suspect: { look: "offline", word: "Late" },
  isolated: { look: "offline", word: "Works alone" },
  syncing: { look: "running", word: "Syncing" },
  quarantined: { look: "doubt", word: "Quarantined" },
  fenced: { look: "doubt", word: "Declared lost" },
  revoked: { look: "stopped", word: "Revoked" },
};

export const sessionState = (state: string): State =>
  SESSION[state] ?? { look: "idle", word: capitalise(state) };

export const SKEW_SHOWN_S = 2;

/** The host's clock against the server's; beyond two seconds it is worth a warning. */
export function skewText(skew: number | null): { text: string; isFar: boolean } {
  if (skew === null) return { text: "not known", isFar: false };
  const far = Math.abs(skew) >= SKEW_SHOWN_S;
  if (!far) return { text: `within ${SKEW_SHOWN_S} s`, isFar: false };
  return {
    text: `${formatDuration(Math.abs(skew))} ${skew > 0 ? "ahead" : "behind"}`,
    isFar: true,
  };
}

type Standing = Pick<Host, "state" | "name" | "journal_lag" | "jobs" | "reason">;

/** One sentence on what the state of a host means for its work. */
export function standingText(host: Standing, since: string | null): string {
  const count = host.jobs.length;
  const work = count === 1 ? "1 job" : `${count} jobs`;
  switch (host.state) {
    case "online":
      return host.journal_lag ? "It answers; the server reads its journal." : "It answers.";
    case "suspect":
      return "It is late: nothing new is sent to it.";
    case "isolated":
      return `Working alone since ${since ?? "it fell silent"}: ${work} from its journal will appear when it is back.`;
    case "syncing":
      return "It is back: the server reads what happened meanwhile.";
    case "quarantined":
    case "fenced":
    case "revoked":
      return host.reason?.message ? `${capitalise(host.reason.message)}.` : "A person has to look.";
    default:
      return "It has not been heard of yet.";
  }
}

const UNHEARD = new Set(["suspect", "isolated", "quarantined", "fenced", "revoked"]);

/** How much of a journal the server has not read; of a host that is not heard nobody knows. */
export function lagText(host: Pick<Host, "state" | "journal_lag">): string {
  const told = `${host.journal_lag} ${host.journal_lag === 1 ? "event" : "events"}`;
  return UNHEARD.has(host.state) ? `not known, ${told} when last heard` : told;
}

/** State of a job at its host; of a host that works alone only the last word is known. */
export function stateAtHost(host: Pick<Host, "state">, job: string): State {
  const state = jobState(job);
  if (host.state !== "isolated" || !isActiveJob(job)) return state;
  return { look: "offline", word: `${state.word} when last heard` };
}

/** Where a vessel is on its way between two hosts. */
export function moveText(move: Pick<Host["moves"][number], "state" | "place">): string {
  const place = move.place ?? "its place";
  return move.state === "in_transit"
    ? `in transit to ${place}: nobody’s until a person says that it is there`
    : `to ${place}: its host was asked to let it go`;
}

/** Time between the click on Stop lab and a host's acknowledgement. */
export function stopTook(after: number | null): string {
  if (after === null) return "";
  return after < 1 ? `after ${Math.round(after * 1000)} ms` : `after ${after.toFixed(1)} s`;
}

export const DISCONNECT: Record<string, string> = {
  continue: "goes on",
  finish_current_then_hold: "ends what acts, then holds",
  stop_safe: "halts safely",
};

/** What a run's hosts do with the server away, in a few words. */
export function executionText(
  execution: { on_disconnect: string; max_offline_s: number } | null,
): string {
  if (!execution) return "ends what acts, then holds";
  const words = DISCONNECT[execution.on_disconnect] ?? capitalise(execution.on_disconnect);
  return execution.on_disconnect === "continue"
    ? `${words} for ${formatDuration(execution.max_offline_s)}`
    : words;
}
