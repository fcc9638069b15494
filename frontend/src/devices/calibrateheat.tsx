/** The form that starts the calibration of a heater: vessel, thermometer and set points. */

import { useState } from "react";
import { useBeginTemperatureCalibration } from "@/api/calibrations";
import { EMPTY_HEAT, heatOrderOf, whyNoHeatOrder, type HeatDraft } from "@/model/calibrationheat";
import type { Device } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { TextField } from "@/ui/controls";
import { Pick, useChoices } from "./choices";
import { words } from "./words";

const said = words.calibration.form;

const TEXTS: [keyof HeatDraft, string][] = [
  ["certificate", said.certificateHeat],
  ["expanded", said.expandedHeat],
  ["due_on", said.due],
  ["set_points", said.setPoints],
  ["settle_min", said.settle],
  ["repeats", said.readings],
  ["stir_rpm", said.stir],
  ["tolerance", said.toleranceHeat],
  ["valid_days", said.days],
];

export function HeatForm({ device, onClose }: { device: Device; onClose: () => void }) {
  const [draft, setDraft] = useState<HeatDraft>(EMPTY_HEAT);
  const begin = useBeginTemperatureCalibration(device.id);
  const { vessels, thermometers } = useChoices();
  const set = (name: keyof HeatDraft) => (value: string | null) =>
    setDraft((old) => ({ ...old, [name]: value ?? "" }));
  const named = thermometers.find((one) => one.value === draft.thermometer_id)?.label ?? "";
  return (
    <AskForm
      name="calibrate"
      asked={begin}
      send={said.send}
      why={whyNoHeatOrder(draft)}
      onSend={() => begin.mutate(heatOrderOf(draft, named), { onSuccess: onClose })}
      onCancel={onClose}
    >
      <p className="help">{said.aboutHeat}</p>
      <Pick
        name="vessel_id"
        label={said.heated}
        value={draft.vessel_id}
        choices={vessels}
        onChange={set("vessel_id")}
      />
      <Pick
        name="thermometer_id"
        label={said.thermometer}
        value={draft.thermometer_id}
        choices={thermometers.filter((one) => one.value !== device.id)}
        onChange={set("thermometer_id")}
      />
      <div className="calfields">
        {TEXTS.map(([name, label]) => (
          <TextField
            key={name}
            label={label}
            value={draft[name]}
            onChange={set(name)}
            type={name === "due_on" ? "date" : "text"}
            testId={`calibrate-${name}`}
          />
        ))}
      </div>
    </AskForm>
  );
}
