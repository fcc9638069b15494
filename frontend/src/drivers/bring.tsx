/** Bring a driver: the file is read at once, every finding has its line, then it is proposed. */

import { useEffect, useId, useState } from "react";
import { Link, useNavigate } from "react-router";
import { useProposeDriver, useReadDriver } from "@/api/drivers";
import { CLASSES, driverState, modelOf, moduleName, partsOf, sourceFinding } from "@/model/drivers";
import { formatBytes } from "@/model/files";
import { formatDigest } from "@/model/format";
import type { DriverReading } from "@/model/wiredrivers";
import type { Finding } from "@/model/wire";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { Forms } from "./forms";
import { words } from "./words";

interface Props {
  isOpen: boolean;
  onClose: () => void;
  /** A file that was dropped on the page. */
  dropped?: File | null;
  /** Driver of which this is to be another version. */
  module?: string;
}

export function BringDriver({ isOpen, onClose, dropped = null, module = "" }: Props) {
  return (
    <Dialog
      title={words.form.title}
      isOpen={isOpen}
      onClose={onClose}
      size={640}
      testId="driver-dialog"
    >
      {isOpen && <BringForm dropped={dropped} module={module} onClose={onClose} />}
    </Dialog>
  );
}

interface Brought {
  name: string;
  size: number;
  text: string;
}

/** The file that was chosen, read anew whenever it or its name changes. */
function useBrought(props: { dropped: File | null; module: string }) {
  const [givenFolder, givenModel] = partsOf(props.module);
  const [file, setFile] = useState<Brought | null>(null);
  const [folder, setFolder] = useState(givenFolder);
  const [model, setModel] = useState(givenModel);
  const reading = useReadDriver();
  const propose = useProposeDriver();
  const module = moduleName(folder, model);
  const choose = async (chosen: File | null): Promise<void> => {
    if (!chosen) return;
    const text = await chosen.text();
    setFile({ name: chosen.name, size: chosen.size, text });
    if (!props.module) setModel(modelOf(chosen.name));
  };
  const { mutate: read, reset } = reading;
  const forget = propose.reset;
  useEffect(() => {
    forget();
    if (file && module) read({ module, source: file.text });
    else reset();
  }, [file, module, read, reset, forget]);
  useEffect(() => {
    if (props.dropped) void choose(props.dropped);
    // eslint-disable-next-line react-hooks/exhaustive-deps -- once, when the dialog opens
  }, []);
  const naming = { folder, model, onFolder: setFolder, onModel: setModel };
  return { file, choose, module, naming, reading, propose };
}

function BringForm(props: { dropped: File | null; module: string; onClose: () => void }) {
  const navigate = useNavigate();
  const [note, setNote] = useState("");
  const { file, choose, module, naming, reading, propose } = useBrought(props);
  const found = reading.data;
  const why = whyNot(Boolean(file && module), reading.isPending, reading.error, found);
  return (
    <form
      className="sheet"
      data-testid="driver-form"
      onSubmit={(event) => {
        event.preventDefault();
        if (!file || !module || why) return;
        propose.mutate(
          { module, source: file.text, note: note.trim() },
          { onSuccess: (row) => void navigate(`/drivers/${row.id}`) },
        );
      }}
    >
      <FileField file={file} onChoose={(chosen) => void choose(chosen)} />
      <ModuleFields {...naming} isFixed={Boolean(props.module)} />
      {reading.isPending && (
        <p className="help" role="status">
          {words.form.reading}
        </p>
      )}
      <Findings error={reading.error} />
      {found && <Found found={found} />}
      {found && !found.known && (
        <TextField
          label={words.form.note}
          value={note}
          onChange={setNote}
          help={words.form.noteHelp}
          lines={2}
          testId="driver-note"
        />
      )}
      <Refused error={propose.error} />
      <div className="acts">
        <Button onClick={props.onClose} large>
          Cancel
        </Button>
        <Button
          type="submit"
          look="pri"
          large
          why={why}
          disabled={propose.isPending}
          testId="driver-propose"
        >
          {words.form.propose}
        </Button>
      </div>
    </form>
  );
}

function whyNot(
  isGiven: boolean,
  isPending: boolean,
  error: Error | null,
  found: DriverReading | undefined,
): string | null {
  if (!isGiven) return words.form.notRead;
  if (isPending) return words.form.reading;
  if (error) return words.form.broken;
  const state = found?.known?.state;
  return state === "proposed" || state === "approved" ? words.form.known(state) : null;
}

function FileField(props: { file: Brought | null; onChoose: (file: File | null) => void }) {
  const id = useId();
  return (
    <div
      className="field dropzone"
      onDragOver={(event) => event.preventDefault()}
      onDrop={(event) => {
        event.preventDefault();
        props.onChoose(event.dataTransfer.files[0] ?? null);
      }}
    >
      <label htmlFor={id}>{words.form.file}</label>
      <input
        id={id}
        className="filepick"
        type="file"
        accept=".py"
        data-testid="driver-input"
        onClick={(event) => {
          // The same file, mended, is chosen again: without this no browser tells of it.
          event.currentTarget.value = "";
        }}
        onChange={(event) => props.onChoose(event.target.files?.[0] ?? null)}
      />
      <p className="help">
        {props.file ? `${props.file.name}, ${formatBytes(props.file.size)}` : words.form.fileHelp}
      </p>
    </div>
  );
}

function ModuleFields(props: {
  folder: string;
  model: string;
  isFixed: boolean;
  onFolder: (folder: string) => void;
  onModel: (model: string) => void;
}) {
  const id = useId();
  if (props.isFixed) {
    return <p className="mono s">{`drivers.${props.folder}.${props.model}`}</p>;
  }
  const isBad = props.model !== "" && moduleName("virtual", props.model) === null;
  return (
    <div className="modulefields">
      <div className="field">
        <label htmlFor={id}>{words.form.class}</label>
        <select
          id={id}
          className="inp"
          value={props.folder}
          data-testid="driver-class"
          onChange={(event) => props.onFolder(event.target.value)}
        >
          <option value="">{words.form.choose}</option>
          {CLASSES.map((name) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      </div>
      <TextField
        label={words.form.model}
        value={props.model}
        onChange={props.onModel}
        help={words.form.modelHelp}
        error={isBad ? words.form.badName : null}
        testId="driver-model"
      />
    </div>
  );
}

/** Each place that breaks a rule, with what to write instead. */
export function Findings({ error }: { error: Error | null }) {
  if (!error) return null;
  const found = (error as { findings?: Finding[] }).findings ?? [];
  if (found.length === 0) return <Refused error={error} />;
  return (
    <div role="alert" className="findings" data-testid="driver-findings">
      <p className="help bad">{error.message}</p>
      <ul>
        {found.map((finding, place) => {
          const { rule, where, message, suggestion } = sourceFinding(finding);
          return (
            <li key={place} data-testid="driver-finding">
              <span className="mono t12 m">
                {where} · {rule}
              </span>
              <span>{message}</span>
              {suggestion && (
                <span className="s">
                  {words.form.instead} {suggestion}
                </span>
              )}
            </li>
          );
        })}
      </ul>
    </div>
  );
}

function Found({ found }: { found: DriverReading }) {
  return (
    <div className="found" data-testid="driver-found">
      <p className="keeps">
        <span className="tone-ok">
          <Glyph look="ok" />
        </span>
        <span>
          <b className="mono">{found.class_name}</b> {words.form.keeps}
        </span>
        <span className="mono m">{formatDigest(found.digest)}</span>
      </p>
      {found.known && (
        <p className="s">
          {words.form.known(driverState(found.known.state).word.toLowerCase())}{" "}
          <Link className="link" to={`/drivers/${found.known.id}`}>
            {words.form.see}
          </Link>
        </p>
      )}
      <Forms about={found} />
    </div>
  );
}
