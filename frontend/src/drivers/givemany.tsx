/** Give a version to several devices at once: to all that are ticked, or to none. */

import { useState } from "react";
import { useGiveDriverToMany, usePartChangesOf } from "@/api/drivers";
import type { DriverDetail, DriverPlace } from "@/model/wiredrivers";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { words } from "./words";

const text = words.places.many;

/** Devices that could get a version and are not changing just now. */
export function candidatesOf(driver: DriverDetail): DriverPlace[] {
  if (driver.state !== "approved") return [];
  return driver.places.filter(
    (place) =>
      place.can_change && place.driver.next === null && place.driver.version_id !== driver.id,
  );
}

/** So many may be given it in one call. */
const MOST = 200;

interface Props {
  driver: DriverDetail;
  candidates: DriverPlace[];
  onClose: () => void;
}

export function GiveToMany({ driver, candidates: all, onClose }: Props) {
  const candidates = all.slice(0, MOST);
  const give = useGiveDriverToMany(driver.id);
  const [ticked, setTicked] = useState<string[]>([]);
  const [reason, setReason] = useState("");
  const ids = candidates.map((place) => place.id);
  const parts = usePartChangesOf(ids, driver.id);
  const why = candidates.map((_, index) => whyAlone(parts[index]));
  const free = candidates.filter((_, index) => why[index] === null).map((place) => place.id);
  const chosen = free.filter((id) => ticked.includes(id));
  return (
    <Dialog title={text.title} isOpen onClose={onClose} testId="many-dialog">
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          if (!chosen.length || !reason.trim()) return;
          const devices = chosen.map((id) => ({ device_id: id }));
          give.mutate({ devices, reason: reason.trim() }, { onSuccess: onClose });
        }}
      >
        <p className="s">{text.text}</p>
        <Devices places={candidates} why={why} chosen={chosen} onChoose={setTicked} />
        {all.length > MOST && <p className="help">{text.more(MOST, all.length)}</p>}
        <TextField
          label={words.places.dialog.reason}
          value={reason}
          onChange={setReason}
          help={words.places.dialog.reasonHelp}
          lines={2}
          testId="many-reason"
        />
        <Refused error={give.error} />
        <div className="acts">
          <Button onClick={onClose} large>
            Cancel
          </Button>
          <Button
            type="submit"
            look="pri"
            large
            why={whyNot(chosen.length, reason)}
            disabled={give.isPending}
            testId="many-send"
          >
            {text.send(chosen.length)}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}

function Devices(props: {
  places: DriverPlace[];
  /** Why a device cannot be ticked, in their order. */
  why: (string | null)[];
  chosen: string[];
  onChoose: (ids: string[]) => void;
}) {
  const { places, why, chosen, onChoose } = props;
  const free = places.filter((_, index) => why[index] === null).map((place) => place.id);
  const isSome = chosen.length > 0 && chosen.length < free.length;
  return (
    <fieldset className="many">
      <legend>{text.devices}</legend>
      <label className="check all">
        <input
          type="checkbox"
          checked={chosen.length > 0 && !isSome}
          ref={(box) => {
            if (box) box.indeterminate = isSome;
          }}
          disabled={!free.length}
          data-testid="many-all"
          onChange={(event) => onChoose(event.target.checked ? free : [])}
        />
        {text.all(free.length)}
      </label>
      <ul>
        {places.map((place, index) => (
          <li key={place.id}>
            <label className="check">
              <input
                type="checkbox"
                checked={chosen.includes(place.id)}
                disabled={why[index] !== null}
                data-testid="many-device"
                data-device={place.key}
                onChange={(event) =>
                  onChoose(
                    event.target.checked
                      ? [...chosen, place.id]
                      : chosen.filter((id) => id !== place.id),
                  )
                }
              />
              <span>
                <b>{place.name}</b> <span className="t12 m">{place.host.name}</span>
                {why[index] && <span className="help">{why[index]}</span>}
              </span>
            </label>
          </li>
        ))}
      </ul>
    </fieldset>
  );
}

function whyNot(count: number, reason: string): string | null {
  if (!count) return text.noDevice;
  return reason.trim() ? null : words.places.dialog.noReason;
}

type Look = ReturnType<typeof usePartChangesOf>[number];

/** Why a device is not given the version with others; null: it may be. */
function whyAlone(look: Look | undefined): string | null {
  if (look?.error) return look.error.message;
  if (!look?.data) return words.places.dialog.looking;
  return look.data.decision || look.data.findings.length ? text.alone : null;
}
