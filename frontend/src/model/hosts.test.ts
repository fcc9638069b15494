import { describe, expect, it } from "vitest";
import {
  executionText,
  lagText,
  moveText,
  sessionState,
  skewText,
  standingText,
  stateAtHost,
  stopTook,
} from "./hosts";

const host = {
  state: "isolated" as const,
  name: "bench 2",
  journal_lag: 0,
  jobs: [],
  reason: null,
};

describe("a host's standing", () => {
  it("has a word and a look for every state of a session", () => {
    for (const state of [
      "enrolling",
      "online",
      "suspect",
      "isolated",
      "syncing",
      "quarantined",
      "fenced",
      "revoked",
    ]) {
      expect(sessionState(state).word).not.toBe("");
    }
    expect(sessionState("fenced")).toEqual({ look: "doubt", word: "Declared lost" });
    expect(sessionState("new_state").word).toBe("New state");
  });

  it("claims no lag and no state of work that nobody has heard since", () => {
    const heard = { state: "online" as const, journal_lag: 1 };
    expect(lagText(heard)).toBe("1 event");
    expect(lagText({ ...heard, state: "isolated" })).toBe("not known, 1 event when last heard");
    expect(stateAtHost(heard, "running").word).toBe("Running");
    const away = stateAtHost({ state: "isolated" }, "running");
    expect(away).toEqual({ look: "offline", word: "Running when last heard" });
    expect(stateAtHost({ state: "isolated" }, "suspended").word).toBe("Suspended");
  });

  it("says since when a host works alone", () => {
    expect(standingText(host, "14:02")).toContain("Working alone since 14:02: 0 jobs");
  });

  it("gives the reason of a quarantine", () => {
    const reason = { code: "host.gap", message: "expected event 4" };
    expect(standingText({ ...host, state: "quarantined", reason }, null)).toBe("Expected event 4.");
  });
});

describe("beside a host", () => {
  it("warns of a clock that is far off, to either side", () => {
    expect(skewText(0.4)).toEqual({ text: "within 2 s", isFar: false });
    expect(skewText(86_400).text).toContain("ahead");
    expect(skewText(-86_400)).toMatchObject({ isFar: true });
    expect(skewText(null).text).toBe("not known");
  });

  it("says where a vessel is on its way", () => {
    expect(moveText({ state: "in_transit", place: "Bench 2" })).toContain("in transit to Bench 2");
    expect(moveText({ state: "leaving", place: null })).toContain("asked to let it go");
  });

  it("tells how long a stop took to be acknowledged", () => {
    expect(stopTook(0.1234)).toBe("after 123 ms");
    expect(stopTook(2.04)).toBe("after 2.0 s");
    expect(stopTook(null)).toBe("");
  });

  it("tells what a run does with its server away, the default too", () => {
    expect(executionText(null)).toBe("ends what acts, then holds");
    expect(executionText({ on_disconnect: "continue", max_offline_s: 600 })).toMatch(
      /^goes on for/,
    );
    expect(executionText({ on_disconnect: "stop_safe", max_offline_s: 600 })).toBe("halts safely");
  });
});
