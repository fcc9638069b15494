/** The form that starts a calibration: water, balance, its certificate, and the air around. */

import { useState } from "react";
import { useBeginCalibration } from "@/api/calibrations";
import { useSession } from "@/api/queries";
import { EMPTY, orderOf, whyNoOrder, type Draft } from "@/model/calibration";
import type { CalibratedQuantity } from "@/model/wirecalibration";
import type { Device } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, TextField } from "@/ui/controls";
import type { Choice } from "@/ui/picker";
import { HeatForm } from "./calibrateheat";
import { PhForm } from "./calibrateph";
import { Pick, useChoices } from "./choices";
import { words } from "./words";

const said = words.calibration;

const FORMS: Record<string, typeof VolumeForm> = { ph: PhForm, temperature: HeatForm };

export function Calibrate(props: { device: Device; kind: CalibratedQuantity; isBusy: boolean }) {
  const { device, kind, isBusy } = props;
  const [isOpen, setIsOpen] = useState(false);
  const Form = FORMS[kind.quantity] ?? VolumeForm;
  const user = useSession().data?.user ?? null;
  const may = user?.permissions.includes("run") ?? false;
  return (
    <>
      <Button
        testId="calibrate"
        why={may ? null : said.mayNot}
        disabled={isBusy}
        onClick={() => setIsOpen(true)}
      >
        {said.button}
      </Button>
      <Dialog
        title={said.form.title(device.name)}
        isOpen={isOpen}
        onClose={() => setIsOpen(false)}
        size={kind.quantity === "ph" ? 800 : 520}
        testId="calibrate-dialog"
      >
        {isOpen && <Form device={device} onClose={() => setIsOpen(false)} />}
      </Dialog>
    </>
  );
}

function VolumeForm({ device, onClose }: { device: Device; onClose: () => void }) {
  const [draft, setDraft] = useState<Draft>(EMPTY);
  const begin = useBeginCalibration(device.id);
  const { vessels, balances } = useChoices();
  const set = (name: keyof Draft) => (value: string | null) =>
    setDraft((old) => ({ ...old, [name]: value ?? "" }));
  const balance = balances.find((one) => one.value === draft.balance_id)?.label ?? "";
  const picks: [keyof Draft, string, Choice[]][] = [
    ["source_id", said.form.source, vessels],
    ["balance_id", said.form.balance, balances],
    ["target_id", said.form.target, vessels],
  ];
  const texts: [keyof Draft, string][] = [
    ["certificate", said.form.certificate],
    ["expanded", said.form.expanded],
    ["due_on", said.form.due],
    ["water_c", said.form.water],
    ["pressure_kpa", said.form.pressure],
    ["humidity", said.form.humidity],
    ["repeats", said.form.repeats],
    ["tolerance", said.form.tolerance],
    ["valid_days", said.form.days],
  ];
  return (
    <AskForm
      name="calibrate"
      asked={begin}
      send={said.form.send}
      why={whyNoOrder(draft)}
      onSend={() => begin.mutate(orderOf(draft, balance), { onSuccess: onClose })}
      onCancel={onClose}
    >
      <p className="help">{said.form.about}</p>
      {picks.map(([name, label, choices]) => (
        <Pick
          key={name}
          name={name}
          label={label}
          value={draft[name]}
          choices={choices}
          onChange={set(name)}
        />
      ))}
      <div className="calfields">
        {texts.map(([name, label]) => (
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
