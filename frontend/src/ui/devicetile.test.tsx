// @vitest-environment jsdom
import { screen } from "@testing-library/react";
import { expect, test } from "vitest";
import type { DeviceRow, JobState } from "@/model/wire";
import { show } from "@/testpage";
import { BenchGrid } from "./devicetile";

function aDevice(link: DeviceRow["link"], isHaltOwed: boolean, state: JobState | null): DeviceRow {
  const job = { id: "j", run_id: "r", run_number: 1, sentence: "Heat to 40 °C", state: "running" };
  return {
    id: "d",
    key: "heater_1",
    name: "Heater 1",
    role: "heater_stirrer",
    kind_label: "Heater-stirrer",
    host: { id: "h", name: "Host 1" },
    state: "admitted",
    link,
    is_halt_owed: isHaltOwed,
    halt: null,
    job: state && { ...job, state },
    readings: [],
  };
}

test.each([
  ["online", false, null, "Idle"],
  ["online", false, "running", "Busy"],
  ["online", true, null, "To be halted"],
  ["online", true, "accepted", "To be halted"],
  ["online", true, "in_doubt", "In doubt"],
  ["offline", true, null, "Offline, to be halted"],
  ["offline", false, null, "Offline"],
] as const)("a device that is %s, a halt owed %s, at work %s, is shown as %s", (...given) => {
  const [link, isHaltOwed, state, word] = given;
  show(<BenchGrid devices={[aDevice(link, isHaltOwed, state)]} />);
  expect(screen.getByTestId("device-tile")).toHaveTextContent(word);
});
