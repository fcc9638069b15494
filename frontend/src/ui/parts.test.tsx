// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { useState } from "react";
import { expect, test } from "vitest";
import { UNITS } from "@/model/samples";
import { runState } from "@/model/states";
import { show } from "@/testpage";
import { Loaded } from "./card";
import { Button } from "./controls";
import { QuantityField, quantityProblem } from "./quantityfield";
import { Picker } from "./picker";
import { StateChip } from "./state";

function Field({ begin = "" }: { begin?: string }) {
  const [value, setValue] = useState(begin);
  const problem = quantityProblem(value, "volume", UNITS);
  return (
    <>
      <QuantityField
        id="v"
        testId="volume"
        value={value}
        dimension="volume"
        units={UNITS}
        preferredUnit="mL"
        onChange={(next) => setValue(next ?? "")}
        isInvalid={problem !== null}
      />
      <output data-testid="stored">{value}</output>
      <p>{problem}</p>
    </>
  );
}

test.each([
  ["250 uL", "250 µL"],
  ["250 µL", "250 µL"],
  ["0.25 mL", "0.25 mL"],
  ["8", "8 mL"],
])("typing %s stores %s", async (typed, stored) => {
  show(<Field />);
  await userEvent.type(screen.getByTestId("volume"), typed);
  expect(screen.getByTestId("stored")).toHaveTextContent(stored);
});

test("after typing, the number stands in the field and the unit beside it", async () => {
  show(<Field />);
  await userEvent.type(screen.getByTestId("volume"), "250 uL");
  await userEvent.tab();
  expect(screen.getByTestId("volume")).toHaveValue("250");
  expect(screen.getByLabelText("Unit")).toHaveValue("µL");
});

test("a mass in a volume field is marked and explained", async () => {
  show(<Field />);
  await userEvent.type(screen.getByTestId("volume"), "5 g");
  expect(screen.getByTestId("volume")).toHaveAttribute("aria-invalid", "true");
  expect(screen.getByText(/g is no unit of volume/)).toBeInTheDocument();
});

test("choosing another unit keeps the number", async () => {
  show(<Field begin="5 mL" />);
  await userEvent.selectOptions(screen.getByLabelText("Unit"), "µL");
  expect(screen.getByTestId("stored")).toHaveTextContent("5 µL");
});

const source = {
  data: undefined,
  error: null,
  isPending: true,
  dataUpdatedAt: 0,
  refetch: () => null,
};

test("a card that fails keeps its last data and says from when it is", () => {
  const failed = { ...source, data: "old rows", error: new Error("The server does not answer.") };
  show(
    <Loaded source={failed} what="runs">
      {(data) => <p>{data}</p>}
    </Loaded>,
  );
  expect(screen.getByText("old rows")).toBeInTheDocument();
  expect(screen.getByTestId("as-of")).toHaveTextContent("The server does not answer.");
});

test("a card without data says what failed, and offers to try again", () => {
  show(
    <Loaded source={{ ...source, error: new Error("no") }} what="runs">
      {() => null}
    </Loaded>,
  );
  expect(screen.getByRole("alert")).toHaveTextContent("Cannot load runs: no");
  expect(screen.getByText("Try again")).toBeInTheDocument();
});

test("every chip has its word", () => {
  show(<StateChip state={runState("paused")} />);
  expect(screen.getByText("Paused")).toHaveAttribute("data-state", "paused");
});

test("a button with a reason against it is disabled", () => {
  show(<Button why="The lab is stopped.">Start</Button>);
  expect(screen.getByRole("button")).toBeDisabled();
});

function Vessels() {
  const [value, setValue] = useState<string | null>(null);
  const choices = ["Waste water", "Water", "Acid"].map((label) => ({ value: label, label }));
  return (
    <Picker
      id="p"
      testId="vessel"
      value={value}
      choices={choices}
      onChange={setValue}
      placeholder="Choose…"
    />
  );
}

test("Enter takes what was typed to the letter before what merely holds it", async () => {
  show(<Vessels />);
  const box = screen.getByTestId("vessel");
  await userEvent.type(box, "water{Enter}");
  await userEvent.tab();
  expect(box).toHaveValue("Water");
  await userEvent.clear(box);
  await userEvent.type(box, "nothing of the sort{Enter}");
  await userEvent.tab();
  expect(box).toHaveValue("Water");
});
