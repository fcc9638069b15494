/** Give a device a version: which one, why, and which of its parts come and go with it. */

import { useId, useState } from "react";
import { useGiveDriver, usePartChanges } from "@/api/drivers";
import type { DriverPlace, DriverRow, PartChanges } from "@/model/wiredrivers";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { versionText } from "./source";
import { words } from "./words";

const text = words.places.dialog;

function VersionField(props: {
  value: string;
  choices: DriverRow[];
  onChange: (id: string) => void;
}) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{text.version}</label>
      <select
        id={id}
        className="inp"
        value={props.value}
        data-testid="change-version"
        onChange={(event) => props.onChange(event.target.value)}
      >
        <option value="">{words.form.choose}</option>
        {props.choices.map((row) => (
          <option key={row.id} value={row.id}>
            {versionText(row)}
          </option>
        ))}
      </select>
    </div>
  );
}

interface Props {
  place: DriverPlace;
  /** The version whose page this is. */
  offered: string;
  choices: DriverRow[];
  onClose: () => void;
}

export function ChangeVersion({ place, offered, choices, onClose }: Props) {
  const give = useGiveDriver(place.id);
  const [isTakingBack] = useState(place.driver.next !== null);
  const [version, setVersion] = useState(place.driver.version_id === offered ? "" : offered);
  const [reason, setReason] = useState("");
  const [agreed, setAgreed] = useState("");
  const parts = usePartChanges(place.id, isTakingBack ? "" : version);
  const wanted = isTakingBack ? place.driver.version_id : version;
  const why = whyNot(wanted, reason, isTakingBack ? undefined : parts.data, agreed);
  const isLooking = !isTakingBack && version !== "" && parts.isFetching && !parts.data;
  return (
    <Dialog title={text.title(place.name)} isOpen onClose={onClose} testId="change-dialog">
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          if (why || isLooking) return;
          const choice = { version_id: wanted, reason: reason.trim() };
          const decided = isTakingBack ? "" : (parts.data?.decision ?? "");
          give.mutate(decided ? { ...choice, parts: decided } : choice, { onSuccess: onClose });
        }}
      >
        <p className="s">{isTakingBack ? text.takeBack : text.text}</p>
        {!isTakingBack && <VersionField value={version} choices={choices} onChange={setVersion} />}
        {!isTakingBack && parts.data && parts.data.changes.length > 0 && (
          <Parts
            parts={parts.data}
            isAgreed={agreed === parts.data.decision}
            onAgree={(yes) => setAgreed(yes ? (parts.data?.decision ?? "") : "")}
          />
        )}
        <TextField
          label={text.reason}
          value={reason}
          onChange={setReason}
          help={text.reasonHelp}
          lines={2}
          autoFocus
          testId="change-reason"
        />
        <Refused error={give.error ?? (isTakingBack ? null : parts.error)} />
        <div className="acts">
          <Button onClick={onClose} large>
            Cancel
          </Button>
          <Button
            type="submit"
            look="pri"
            large
            why={isLooking ? text.looking : why}
            disabled={give.isPending}
            testId="change-send"
          >
            {isTakingBack ? text.keep : text.send}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}

function whyNot(
  wanted: string,
  reason: string,
  parts: PartChanges | undefined,
  agreed: string,
): string | null {
  if (!wanted) return text.noVersion;
  if (parts?.findings.length) return text.blocked;
  if (parts?.decision && agreed !== parts.decision) return text.undecided;
  return reason.trim() ? null : text.noReason;
}

/** What comes, goes and changes; nobody decides on what they were not shown. */
function Parts(props: {
  parts: PartChanges;
  isAgreed: boolean;
  onAgree: (isAgreed: boolean) => void;
}) {
  const { changes, findings } = props.parts;
  return (
    <fieldset className="partchanges" data-testid="part-changes">
      <legend>{text.parts}</legend>
      <ul>
        {changes.map((one) => (
          <li key={`${one.code} ${one.subject}`}>
            <b>{text.verb[one.code.replace("driver.parts_", "")] ?? one.code}</b> {one.message}
          </li>
        ))}
      </ul>
      <p className="help">{text.partsText}</p>
      {findings.map((one) => (
        <p className="help bad" key={`${one.code} ${one.message}`} role="alert">
          {one.message}
        </p>
      ))}
      {findings.length === 0 && (
        <label className="check">
          <input
            type="checkbox"
            checked={props.isAgreed}
            data-testid="part-agree"
            onChange={(event) => props.onAgree(event.target.checked)}
          />
          {text.decide}
        </label>
      )}
    </fieldset>
  );
}
