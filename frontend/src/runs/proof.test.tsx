// @vitest-environment jsdom
/** A run that does something else than was proved: it says so, and is held. */

import { screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { expect, it } from "vitest";
import { aJob, aRun } from "@/model/samples";
import type { Run } from "@/model/wire";
import { serve, show } from "@/testpage";
import { RunHead } from "./head";
import { Departed } from "./proof";

const TOLD = [{ place: "j1", text: "'Dispense 5 mL' was skipped" }];
const CAN = {
  pause: false,
  resume: true,
  abort: true,
  resolve: true,
  recover: true,
  confirm: true,
};

function held(change: Partial<NonNullable<Run["proof"]>> = {}): Run {
  const proof = { departures: TOLD, accepted: [], by: null, at: null, ...change };
  return aRun([aJob(0, "s1", "held")], { state: "paused", proof, can: CAN });
}

it("says what was done otherwise, and goes on only when a person says so", async () => {
  const sent = serve(() => [200, held()]);
  show(<Departed run={held()} />);
  expect(screen.getByTestId("departed-card")).toHaveTextContent("No longer proved");
  expect(screen.getByText(TOLD[0]?.text ?? "")).toBeInTheDocument();
  await userEvent.click(screen.getByTestId("departed-go-on"));
  await waitFor(() => expect(sent).toHaveLength(1));
  expect(sent[0]?.path).toMatch(/resume$/);
  expect(sent[0]?.body).toEqual({ pauses: [], departures: TOLD });
});

it("cannot be resumed past it", () => {
  show(<RunHead run={held()} />);
  expect(screen.getByTestId("resume")).toBeDisabled();
});

it("says who let it go on, and holds it no longer", () => {
  const run = held({ accepted: TOLD, by: "Ada", at: "2026-01-01T00:00:00Z" });
  show(<Departed run={run} />);
  expect(screen.getByTestId("departed-by")).toHaveTextContent("Ada let it go on");
  expect(screen.queryByTestId("departed-go-on")).toBeNull();
});

it("holds a run that leaves the proof in the same words at another place", () => {
  const again = [...TOLD, { place: "j2", text: "'Dispense 5 mL' was skipped" }];
  show(<Departed run={held({ departures: again, accepted: TOLD, by: "Ada" })} />);
  expect(screen.getAllByText(TOLD[0]?.text ?? "")).toHaveLength(2);
  expect(screen.getByTestId("departed-go-on")).toBeEnabled();
});

it("says nothing of a run that does what was proved, or of one that was drawn", () => {
  show(<Departed run={held({ departures: [] })} />);
  show(<Departed run={aRun([])} />);
  expect(screen.queryByTestId("departed-card")).toBeNull();
});
