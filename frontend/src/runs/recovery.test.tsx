// @vitest-environment jsdom
/** The recovery card: choices with their consequences, and what is sent. */

import { fireEvent, screen } from "@testing-library/react";
import { expect, it, vi } from "vitest";
import { aJob, aRow, aRun } from "@/model/samples";
import type { RecoveryCard } from "@/model/wire";
import { serve, show } from "@/testpage";
import { Recovery } from "./recovery";
import { words } from "./words";

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
  moved_ul: 0,
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

const amount = (text: string): void => {
  fireEvent.click(screen.getByTestId("recover-done_by_hand"));
  fireEvent.change(screen.getByTestId("recover-amount"), { target: { value: text } });
  fireEvent.change(screen.getByTestId("recover-note"), { target: { value: "by hand" } });
};

it.each([
  "5,0 mL",
  "5,000",
  "-1 mL",
  "1e9 L",
  "NaN",
  "0x10",
  "Infinity",
  "1e400",
  "0",
  "1e-9",
  "5 g",
])("an amount of %s by hand is refused with a reason", (text) => {
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  amount(text);
  expect(screen.getByTestId("recover-send")).toBeDisabled();
  expect(screen.getByTestId("recover-amount")).toBeInvalid();
});

it("says on the button how much will stand in the record", () => {
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  amount("250 uL");
  expect(screen.getByTestId("recover-send")).toHaveTextContent(/Record 0.25.mL by hand/);
});

it("asks beside what the device has moved, and takes that nothing more was moved", async () => {
  const sent = serve(() => [200, aRun([job])]);
  show(<Recovery run={aRun([job])} job={job} card={{ ...card, moved_ul: 5000 }} />);
  amount("0");
  expect(screen.getByText(/has moved 5.00.mL of 5.00.mL/)).toBeInTheDocument();
  fireEvent.click(screen.getByTestId("recover-send"));
  await vi.waitFor(() => expect(sent).toHaveLength(1));
  expect(sent[0]?.body).toEqual({ choice: "done_by_hand", note: "by hand", moved_ul: 0 });
});

it("says that the run ends where nothing is left after the choice", () => {
  const queued = aJob(1, "s1", "queued");
  show(<Recovery run={aRun([job, queued])} job={job} card={card} />);
  fireEvent.click(screen.getByTestId("recover-done_by_hand"));
  expect(screen.getByTestId("recover-then")).toHaveTextContent("when you resume it");
  fireEvent.click(screen.getByTestId("recover-skip"));
  expect(screen.getByTestId("recover-then")).toHaveTextContent("the run then ends");
});

it("keeps what was written until it is sent, though the page was left", () => {
  const first = show(<Recovery run={aRun([job])} job={job} card={card} />);
  amount("4 mL");
  first.unmount();
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  expect(screen.getByTestId("recover-amount")).toHaveValue("4 mL");
  expect(screen.getByTestId("recover-note")).toHaveValue("by hand");
});

it("offers to abort the run last, says what that leads to, and sends the reason", async () => {
  const sent = serve(() => [200, aRun([job])]);
  show(<Recovery run={aRun([job])} job={job} card={card} />);
  expect(screen.getAllByRole("radio").at(-1)).toBe(screen.getByTestId("recover-abort"));
  expect(screen.getByText(words.abortAbout)).toBeInTheDocument();
  fireEvent.click(screen.getByTestId("recover-abort"));
  expect(screen.getByTestId("recover-send")).toBeDisabled();
  expect(screen.getByTestId("recover-then")).toHaveTextContent("The run ends here");
  fireEvent.change(screen.getByTestId("recover-note"), { target: { value: " the flask broke " } });
  fireEvent.click(screen.getByTestId("recover-send"));
  await vi.waitFor(() => expect(sent).toHaveLength(1));
  expect(sent[0]?.path).toMatch(/runs\/.*\/abort$/);
  expect(sent[0]?.body).toEqual({ reason: "the flask broke" });
});

it("does not offer to abort a run that has ended", () => {
  const run = aRun([job]);
  show(<Recovery run={{ ...run, can: { ...run.can, abort: false } }} job={job} card={card} />);
  expect(screen.getByTestId("recover-abort")).toBeDisabled();
});

it("offers things of the lab by their names among the values", () => {
  serve(() => [200, { resources: [aRow("dcd7477f-1d76-5d8e-a4db-c400a4c6604f", null)] }]);
  const change = { name: "change" as const, why_not: null, consequence: "Plans anew." };
  const params = { source: "dcd7477f-1d76-5d8e-a4db-c400a4c6604f", volume: "4 mL" };
  show(<Recovery run={aRun([job])} job={job} card={{ ...card, choices: [change], params }} />);
  fireEvent.click(screen.getByTestId("recover-change"));
  expect(screen.getByTestId("recover-param-source")).toHaveAttribute("role", "combobox");
  expect(screen.getByLabelText("Volume")).toHaveValue("4 mL");
});
