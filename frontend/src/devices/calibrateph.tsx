/** The form that starts the calibration of a probe: its buffers, and how they get there. */

import { useState } from "react";
import { useBeginPhCalibration } from "@/api/calibrations";
import {
  EMPTY_PH,
  phOrderOf,
  STANDARDS,
  whyNoPhOrder,
  type BufferDraft,
  type PhDraft,
} from "@/model/calibrationph";
import type { Device } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { TextField } from "@/ui/controls";
import type { Choice } from "@/ui/picker";
import { Pick, useChoices } from "./choices";
import { words } from "./words";

const said = words.calibration.form;

type Text = Exclude<keyof PhDraft, "buffers">;

export function PhForm({ device, onClose }: { device: Device; onClose: () => void }) {
  const [draft, setDraft] = useState<PhDraft>(EMPTY_PH);
  const begin = useBeginPhCalibration(device.id);
  const { vessels } = useChoices();
  const set = (name: Text) => (value: string | null) =>
    setDraft((old) => ({ ...old, [name]: value ?? "" }));
  const setBuffer = (place: number, changed: Partial<BufferDraft>): void =>
    setDraft((old) => ({
      ...old,
      buffers: old.buffers.map((one, at) => (at === place ? { ...one, ...changed } : one)),
    }));
  const texts: [Text, string][] = [
    ["volume_ml", said.volume],
    ["repeats", said.readings],
    ["tolerance", said.tolerancePh],
    ["valid_days", said.days],
  ];
  return (
    <AskForm
      name="calibrate"
      asked={begin}
      send={said.send}
      why={whyNoPhOrder(draft)}
      onSend={() => begin.mutate(phOrderOf(draft), { onSuccess: onClose })}
      onCancel={onClose}
    >
      <p className="help">{said.aboutPh}</p>
      <div className="calfields">
        <Places draft={draft} onChange={set} />
      </div>
      {draft.buffers.map((one, place) => (
        <BufferFields
          key={place}
          place={place}
          draft={one}
          vessels={vessels}
          onChange={(changed) => setBuffer(place, changed)}
        />
      ))}
      <div className="calfields">
        {texts.map(([name, label]) => (
          <TextField
            key={name}
            label={label}
            value={draft[name]}
            onChange={set(name)}
            testId={`calibrate-${name}`}
          />
        ))}
      </div>
    </AskForm>
  );
}

function Places(props: {
  draft: PhDraft;
  onChange: (name: Text) => (value: string | null) => void;
}) {
  const { vessels, pumps } = useChoices();
  const picks: [Text, string, Choice[]][] = [
    ["pump_id", said.pump, pumps],
    ["vessel_id", said.vessel, vessels],
    ["waste_id", said.waste, vessels],
  ];
  return picks.map(([name, label, choices]) => (
    <Pick
      key={name}
      name={name}
      label={label}
      value={props.draft[name]}
      choices={choices}
      onChange={props.onChange(name)}
    />
  ));
}

function BufferFields(props: {
  place: number;
  draft: BufferDraft;
  vessels: Choice[];
  onChange: (changed: Partial<BufferDraft>) => void;
}) {
  const { place, draft, vessels, onChange } = props;
  return (
    <fieldset className="calbuffer">
      <legend>{said.buffer(place + 1)}</legend>
      <div className="calfields">
        <Pick
          name={`standard-${place}`}
          label="Standard"
          value={draft.standard}
          choices={[...STANDARDS]}
          onChange={(standard) => onChange({ standard: standard ?? "" })}
        />
        <Pick
          name={`source-${place}`}
          label={said.from}
          value={draft.source_id}
          choices={vessels}
          onChange={(source) => onChange({ source_id: source ?? "" })}
        />
        <TextField
          label={said.lot}
          value={draft.lot}
          onChange={(lot) => onChange({ lot })}
          testId={`calibrate-lot-${place}`}
        />
        <TextField
          label={said.bufferExpanded}
          value={draft.expanded}
          onChange={(expanded) => onChange({ expanded })}
          testId={`calibrate-expanded-${place}`}
        />
        <TextField
          label={said.due}
          value={draft.due_on}
          onChange={(due_on) => onChange({ due_on })}
          type="date"
          testId={`calibrate-due-${place}`}
        />
      </div>
    </fieldset>
  );
}
