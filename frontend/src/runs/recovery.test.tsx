// @vitest-environment jsdom
/** The recovery card: choices with their consequences, and what is sent. */

import { fireEvent, screen } from "@testing-library/react";
import { expect, it } from "vitest";
import { aJob, aRun } from "@/model/samples";
import type { RecoveryCard } from "@/model/wire";
import { show } from "@/testpage";
import { Recovery } from "./recovery";

const card: RecoveryCard = {
  recovery: "R2",
  tries: 1,
  choices: [
    { name: "retry", why_not: "a part has moved", consequence: "Sends it again." },
    { name: "skip", why_not: null, consequence: "Leaves it undone." },
    { name: "done_by_hand", why_not: null, consequence: "You did it." },
  ],
  skips: ["Dispense 5 mL"],
  relying: ["Heat the reactor"],
  asked_ul: 5000,
  params: {},
};

const job = aJob(0, "s1", "aborted");

it("offers what may be done, and says why the rest may not", () => {
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  expect(screen.getByTestId("recover-retry")).toBeDisabled();
  expect(screen.getByText("Not now: a part has moved.")).toBeInTheDocument();
  expect(screen.getByTestId("recover-send")).toBeDisabled();
});

it.each([
  ["R0", /device can be asked/],
  ["R1", /set-point/],
  ["R2", /measurement tells how far/],
  ["R3", /No device and no measurement/],
])("says what tells how far an action of class %s came", (recovery, text) => {
  show(<Recovery run={aRun([job])} job={job} card={{ ...card, recovery }} />);
  expect(screen.getByTestId("recovery-class")).toHaveTextContent(text);
});

it("lists what a skip leads to before it is sent", () => {
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  fireEvent.click(screen.getByTestId("recover-skip"));
  expect(screen.getByTestId("recover-consequences").textContent).toContain("Dispense 5 mL");
  expect(screen.getByTestId("recover-consequences").textContent).toContain("Heat the reactor");
});

it("wants the amount of what was done by hand, and why", () => {
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  fireEvent.click(screen.getByTestId("recover-done_by_hand"));
  expect(screen.getByTestId("recover-send")).toBeDisabled();
  fireEvent.change(screen.getByTestId("recover-amount"), { target: { value: "4.5" } });
  fireEvent.change(screen.getByTestId("recover-note"), { target: { value: "with a pipette" } });
  expect(screen.getByTestId("recover-send")).toBeEnabled();
});
