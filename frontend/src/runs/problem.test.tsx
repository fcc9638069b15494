// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import { expect, test } from "vitest";
import { aJob, aRun, iso } from "@/model/samples";
import { serve, show } from "@/testpage";
import { Problems } from "./problem";

const paused = (kind: string) =>
  aRun([aJob(0, "a", "queued")], {
    state: "paused",
    pause_reasons: [{ kind, by: "Li Na", at: iso(1) }],
  });

test("a run that a stop of the lab paused warns of what was halted with it", () => {
  serve(() => [200, { devices: [] }]);
  const view = show(<Problems run={paused("stopped")} job={null} />);
  expect(screen.getByTestId("halted")).toHaveTextContent(/may be off/);
  expect(screen.getByText("Lab stopped by Li Na")).toBeInTheDocument();
  view.unmount();
  show(<Problems run={paused("user")} job={null} />);
  expect(screen.queryByTestId("halted")).toBeNull();
});

test("a failure says how much moved of what was asked for", () => {
  serve(() => [200, { devices: [] }]);
  const recovery = {
    recovery: "R2",
    tries: 1,
    choices: [],
    skips: [],
    relying: [],
    asked_ul: 5000,
    moved_ul: 2740,
    params: {},
  };
  const transaction = { id: "t", state: "committed" };
  const job = aJob(0, "a", "aborted", { transaction, recovery });
  show(<Problems run={aRun([job], { state: "paused" })} job={null} />);
  const effect = screen.getByTestId("problem-effect");
  expect(effect).toHaveTextContent("2.74 mL of 5.00 mL moved, by the record.");
});
