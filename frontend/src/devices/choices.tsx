/** Fields that choose one of what the lab has. */

import { useId } from "react";
import { useDevices, useResources } from "@/api/queries";
import type { DeviceRow } from "@/model/wire";
import { Picker, type Choice } from "@/ui/picker";
import { words } from "./words";

const said = words.calibration;

export function Pick(props: {
  name: string;
  label: string;
  value: string;
  choices: Choice[];
  onChange: (value: string | null) => void;
}) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      <Picker
        id={id}
        value={props.value || null}
        choices={props.choices}
        onChange={props.onChange}
        placeholder={said.form.choose}
        testId={`calibrate-${props.name}`}
      />
    </div>
  );
}

/** A sensor that tells the temperature of what it dips into. */
const isThermometer = (row: DeviceRow): boolean =>
  row.role.endsWith("_sensor") && row.readings.some((one) => one.status === "temperature_c");

/** Vessels that water may stand in, and devices that weigh, pump or measure a temperature. */
export function useChoices(): {
  vessels: Choice[];
  balances: Choice[];
  pumps: Choice[];
  thermometers: Choice[];
} {
  const resources = useResources().data ?? [];
  const devices = useDevices().data ?? [];
  const vessels = resources
    .filter((row) => row.holds_liquid && row.kind !== "syringe_pump")
    .map((row) => ({ value: row.id, label: row.name, note: row.kind.replaceAll("_", " ") }));
  const balances = devices
    .filter((row) => row.role === "balance" && row.state === "enrolled")
    .map((row) => ({ value: row.id, label: row.name }));
  const pumps = devices
    .filter((row) => row.role === "pump" && row.state === "enrolled")
    .map((row) => ({ value: row.id, label: row.name }));
  const thermometers = devices
    .filter((row) => row.state === "enrolled" && isThermometer(row))
    .map((row) => ({ value: row.id, label: row.name }));
  return { vessels, balances, pumps, thermometers };
}
