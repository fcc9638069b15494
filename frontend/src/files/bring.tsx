/** Bring a file: what it is about, how it is read, how much of it has been sent. */

import { useId, useState } from "react";
import { useNavigate } from "react-router";
import type { About } from "@/api/files";
import { useDevices, useResources } from "@/api/queries";
import { useSendFile } from "@/api/upload";
import { FORMATS, formatBytes, usualFormat, whyNotSent } from "@/model/files";
import type { Finding } from "@/model/wire";
import { Button, Dialog } from "@/ui/controls";
import { Progress } from "@/ui/number";
import { Picker } from "@/ui/picker";
import { words } from "./words";

export function BringDialog(props: { isOpen: boolean; onClose: () => void; about: About }) {
  return (
    <Dialog
      title={words.form.title}
      isOpen={props.isOpen}
      onClose={props.onClose}
      size={520}
      testId="bring-dialog"
    >
      {props.isOpen && <BringForm about={props.about} onClose={props.onClose} />}
    </Dialog>
  );
}

function BringForm({ about, onClose }: { about: About; onClose: () => void }) {
  const navigate = useNavigate();
  const { send, share } = useSendFile();
  const [file, setFile] = useState<File | null>(null);
  const [format, setFormat] = useState("none");
  const [resource, setResource] = useState(about.resource);
  const [device, setDevice] = useState(about.device);
  const choose = (chosen: File | null): void => {
    setFile(chosen);
    if (chosen) setFormat(usualFormat(chosen.name));
    send.reset();
  };
  const why = whyNotSent(file, Boolean(resource ?? device ?? about.job));
  const submit = (): void => {
    if (!file || why) return;
    send.mutate(
      { file, format, resource, device, job: about.job },
      { onSuccess: (kept) => void navigate(`/files/${kept.id}`) },
    );
  };
  return (
    <form
      className="sheet"
      data-testid="bring-form"
      onSubmit={(event) => {
        event.preventDefault();
        submit();
      }}
    >
      <FileField file={file} onChoose={choose} />
      <FormatField value={format} onChange={setFormat} />
      {about.job ? (
        <p className="help">{words.form.job}</p>
      ) : (
        <DeviceField value={device} onChange={setDevice} />
      )}
      <ResourceField value={resource} onChange={setResource} />
      {send.isPending && <Sending share={share} />}
      <RefusedByRow error={send.error} />
      <div className="acts">
        <Button onClick={onClose} large>
          Cancel
        </Button>
        <Button
          type="submit"
          look="pri"
          large
          why={why}
          disabled={send.isPending}
          testId="bring-send"
        >
          {send.isPending ? words.form.sending : words.form.send}
        </Button>
      </div>
    </form>
  );
}

function Sending({ share }: { share: number }) {
  return (
    <p className="sending" role="status" data-testid="upload-progress">
      <Progress share={share} />
      <span className="num">{share < 1 ? `${Math.round(share * 100)} %` : words.form.reading}</span>
    </p>
  );
}

function FileField(props: { file: File | null; onChoose: (file: File | null) => void }) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{words.form.file}</label>
      <input
        id={id}
        className="filepick"
        type="file"
        data-testid="bring-input"
        onChange={(event) => props.onChoose(event.target.files?.[0] ?? null)}
      />
      <p className="help">{props.file ? formatBytes(props.file.size) : words.form.help}</p>
    </div>
  );
}

function FormatField(props: { value: string; onChange: (value: string) => void }) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{words.form.format}</label>
      <select
        id={id}
        className="inp"
        data-testid="bring-format"
        value={props.value}
        onChange={(event) => props.onChange(event.target.value)}
      >
        {FORMATS.map((format) => (
          <option key={format.value} value={format.value}>
            {format.label}
          </option>
        ))}
      </select>
    </div>
  );
}

interface PickProps {
  value: string | null;
  onChange: (value: string | null) => void;
}

function ResourceField(props: PickProps) {
  const id = useId();
  const { data: rows = [] } = useResources();
  const choices = rows.map((row) => ({ value: row.id, label: row.name, note: row.kind_label }));
  return (
    <div className="field">
      <label htmlFor={id}>{words.form.resource}</label>
      <Picker
        {...props}
        id={id}
        choices={choices}
        placeholder={words.form.resourceHint}
        canClear
        testId="bring-resource"
      />
    </div>
  );
}

function DeviceField(props: PickProps) {
  const id = useId();
  const { data: rows = [] } = useDevices();
  const choices = rows.map((row) => ({ value: row.id, label: row.name, note: row.kind_label }));
  return (
    <div className="field">
      <label htmlFor={id}>{words.form.device}</label>
      <Picker
        {...props}
        id={id}
        choices={choices}
        placeholder={words.form.deviceHint}
        canClear
        testId="bring-device"
      />
    </div>
  );
}

/** What is wrong with the file, each finding with its row. */
function RefusedByRow({ error }: { error: Error | null }) {
  if (!error) return null;
  const told = (error as { refusal?: { code: string; findings: Finding[] } }).refusal;
  const findings = told?.findings ?? [];
  return (
    <div className="refused" role="alert" data-testid="refused">
      <p className="help bad">{error.message}</p>
      {findings.length > 0 && (
        <table className="byrow">
          <thead>
            <tr>
              <th>Where</th>
              <th>What</th>
            </tr>
          </thead>
          <tbody>
            {findings.map((finding, place) => (
              <tr key={place}>
                <td className="mono">{finding.subject || "–"}</td>
                <td className="bad">{finding.message}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      {told && <p className="mono m">{told.code}</p>}
    </div>
  );
}
