// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import { expect, test } from "vitest";
import promises from "@/model/promises.json";
import { aJob, aRun, iso } from "@/model/samples";
import type { DeviceHalt } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Halts } from "./halts";
import { RunHead } from "./head";
import { Problems } from "./problem";
import { words } from "./words";

const can = {
  pause: false,
  resume: false,
  abort: true,
  resolve: true,
  recover: false,
  confirm: false,
};
const aHalt = (state: DeviceHalt["state"], message = ""): DeviceHalt => ({
  id: state,
  device: { id: state, name: `Heater ${state}` },
  state,
  message,
  at: iso(1),
  ended_at: null,
  run: { id: "run-1", number: 418 },
  by: "Li Na",
});

test("an aborted run shows which device is being halted, which stands and which owes its halt", () => {
  const halts = [aHalt("taken"), aHalt("owed", "it does not answer"), aHalt("halted", "it stands")];
  show(<Halts run={aRun([], { is_given_up: true, halts })} />);
  expect(screen.getAllByTestId("halt").map((item) => item.textContent)).toEqual([
    "Heater takenBeing halted",
    "Heater owedNot halted yetit does not answer",
    "Heater haltedHaltedit stands",
  ]);
});

test("an aborted run says who aborted it and why, and lists once what never began", () => {
  serve(() => [200, { devices: [] }]);
  const run = aRun(
    [
      aJob(0, "a", "complete", { halted_by: "edge.run_aborted" }),
      aJob(1, "a", "aborted"),
      aJob(2, "b", "stopped"),
      aJob(3, "c", "stopped"),
    ],
    {
      is_given_up: true,
      state: "aborted",
      given_up: { by: "Li Na", at: iso(1), reason: "it smells" },
    },
  );
  show(
    <>
      <Halts run={run} />
      <Problems run={run} job={null} />
    </>,
  );
  expect(screen.getByTestId("halts")).toHaveTextContent("Aborted by Li Na");
  expect(screen.getByText("it smells")).toBeInTheDocument();
  expect(screen.getByTestId("never-began")).toHaveTextContent("2 actions never began");
  expect(screen.getAllByTestId("problem-card").map((card) => card.dataset.job)).toEqual([
    run.jobs[1]?.id,
  ]);
});

test("a run that nobody has aborted shows no halts", () => {
  show(<Halts run={aRun([])} />);
  expect(screen.queryByTestId("halts")).toBeNull();
});

test("a run that is being aborted says so and offers nothing else", () => {
  serve(() => [200, {}]);
  show(<RunHead run={aRun([aJob(0, "a", "running")], { is_given_up: true, can })} />);
  expect(screen.getByTestId("run-state")).toHaveTextContent("Aborting");
  expect(screen.getByTestId("aborting")).toHaveTextContent("ends once each of its devices stands");
  expect(screen.queryByTestId("pause")).toBeNull();
  expect(screen.queryByTestId("abort")).toBeNull();
});

test("the dialog of an abort promises what is kept, and nothing else", () => {
  const { begins, acts, stands, owed, liquid } = promises.abort;
  expect(words.abortAbout).toBe([begins, acts, stands, owed, liquid].join(" "));
  expect([words.abortDoubt, words.recovery.aborts]).toEqual([
    promises.abort.doubt,
    promises.abort.ends,
  ]);
});
