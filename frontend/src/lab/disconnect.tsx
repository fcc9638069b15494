/** A connection that comes off the physical graph: said by a person who has done it. */

import { useEffect, useState } from "react";
import { useDisconnect } from "@/api/commands";
import type { Resource } from "@/model/wire";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, TextField } from "@/ui/controls";
import { words } from "./words";

type Port = Resource["ports"][number];

const DRY: readonly string[] = ["mechanical", "electrical", "communication", "transport"];

const NAME = "[data-testid=resource] h2";

/** A button that is gone with its port leaves the focus at the name of what it stood beside. */
function useFocusAfterwards(): void {
  useEffect(
    () => () => {
      if (document.activeElement === document.body)
        document.querySelector<HTMLElement>(NAME)?.focus();
    },
    [],
  );
}

/** The button beside a port, and its dialog. */
export function TakeOff({ resource, port }: { resource: Resource; port: Port }) {
  const [isOpen, setIsOpen] = useState(false);
  const close = (): void => setIsOpen(false);
  const to = port.to?.name ?? "";
  useFocusAfterwards();
  return (
    <>
      <Button
        testId="take-off"
        why={port.may_disconnect ? null : words.disconnect.mayNot}
        onClick={() => setIsOpen(true)}
      >
        {words.disconnect.button}
      </Button>
      <Dialog
        title={`${words.disconnect.title} ${resource.name} – ${to}`}
        isOpen={isOpen}
        onClose={close}
        size={480}
        testId="take-off-dialog"
      >
        <TakeOffForm resource={resource} port={port} onClose={close} />
      </Dialog>
    </>
  );
}

function TakeOffForm(props: { resource: Resource; port: Port; onClose: () => void }) {
  const { resource, port, onClose } = props;
  const asked = useDisconnect();
  const [isEmpty, setIsEmpty] = useState(false);
  const [note, setNote] = useState("");
  const isDry = DRY.includes(port.medium);
  const isSaid = note.trim() !== "" && (isDry || isEmpty);
  const send = (): void => {
    const wanted = { ...port.connection, is_seen_empty: isEmpty, note };
    asked.mutate(wanted, { onSuccess: onClose });
  };
  return (
    <AskForm
      name="take-off"
      asked={asked}
      send={words.disconnect.send}
      why={isSaid ? null : isDry ? words.disconnect.sayWhy : words.disconnect.sayBoth}
      onSend={send}
      onCancel={onClose}
    >
      <p className="help">
        {words.disconnect.about(
          `${resource.name}, port ${port.port}`,
          `${port.to?.name ?? ""}, port ${port.to?.port ?? ""}`,
        )}
      </p>
      {!isDry && (
        <label className="check">
          <input
            type="checkbox"
            data-autofocus
            checked={isEmpty}
            onChange={(event) => setIsEmpty(event.target.checked)}
            data-testid="take-off-empty"
          />{" "}
          {words.disconnect.empty}
        </label>
      )}
      <TextField
        label={words.disconnect.reason}
        value={note}
        onChange={setNote}
        lines={2}
        autoFocus={isDry}
        testId="take-off-reason"
      />
    </AskForm>
  );
}
