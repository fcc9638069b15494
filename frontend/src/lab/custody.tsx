/** A vessel between two edge hosts: asked for, released, in transit, received; and how it begins. */

import { useId, useState } from "react";
import { useArrival, useCarry } from "@/api/commands";
import { useTopics } from "@/api/live";
import { useCustody, useResources } from "@/api/queries";
import { sentence } from "@/model/format";
import { connectedText, placesFor, stepOf, whereText } from "@/model/custody";
import type { Custody, Resource } from "@/model/wire";
import { Failed } from "@/ui/card";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { Picker, type Choice } from "@/ui/picker";
import { At } from "@/ui/time";
import { words } from "./words";

type Move = NonNullable<Custody["move"]>;

/** Where a vessel is on its way, and what is to be done about it; nothing where it is not. */
export function OnItsWay({ resource }: { resource: Resource }) {
  const custody = useCustody(resource.id);
  useTopics("hosts", "events");
  if (custody.error)
    return <Failed what="in whose hands it is" error={custody.error} retry={custody.refetch} />;
  const move = custody.data?.move;
  if (!custody.data || !move) return null;
  return <Journey move={move} isAllowed={custody.data.is_allowed} />;
}

function Journey({ move, isAllowed }: { move: Move; isAllowed: boolean }) {
  const arrival = useArrival();
  const step = stepOf(move);
  const isOnTheRoad = step !== "asked";
  const look = step === "released" ? "needs" : "queued";
  const since = isOnTheRoad ? (move.released_at ?? move.asked_at) : move.asked_at;
  return (
    <section className="journey" data-testid="custody" data-step={step}>
      <p className="quar">
        <span className="chip" data-state={look}>
          <Glyph look={look} />
          {isOnTheRoad ? words.custody.inTransit : words.custody.leaving}
        </span>
        <span>
          {words.custody.from} <b>{move.from?.name ?? words.custody.itsHost}</b> {words.custody.to}{" "}
          <b>{move.to?.name}</b> {words.custody.since} <At at={since} />
        </span>
      </p>
      <ol className="steps s">
        <li data-done>
          {words.custody.asked} {move.asked_by ?? ""} <At at={move.asked_at} />
        </li>
        <li data-done={isOnTheRoad || undefined}>
          {isOnTheRoad ? words.custody.released : words.custody.notReleased}{" "}
          {isOnTheRoad && <At at={move.released_at} />}
        </li>
        <li>{step === "told" ? words.custody.told : words.custody.notReceived}</li>
      </ol>
      <p className="help">{whereText(move)}</p>
      {step === "released" && (
        <Button
          look="pri"
          testId="custody-receive"
          disabled={arrival.isPending}
          why={isAllowed ? null : words.custody.mayNot}
          onClick={() => arrival.mutate(move.id)}
        >
          {words.custody.receive}
        </Button>
      )}
      <Refused error={arrival.error} />
    </section>
  );
}

/** The button that begins a move, and its dialog. */
export function Carry({ resource }: { resource: Resource }) {
  const custody = useCustody(resource.id);
  const [isOpen, setIsOpen] = useState(false);
  const close = (): void => setIsOpen(false);
  return (
    <>
      <Button testId="carry" why={whyNot(custody.data)} onClick={() => setIsOpen(true)}>
        {words.custody.button}
      </Button>
      <Dialog
        title={`${words.custody.title} ${resource.name}`}
        isOpen={isOpen}
        onClose={close}
        size={480}
        testId="carry-dialog"
      >
        {custody.data && <CarryForm resource={resource} custody={custody.data} onClose={close} />}
      </Dialog>
    </>
  );
}

function whyNot(custody: Custody | undefined): string | null {
  if (!custody) return "Loading…";
  if (!custody.is_allowed) return words.custody.mayNot;
  if (custody.move) return words.custody.onItsWay;
  return custody.connections.length ? connectedText(custody.connections) : null;
}

function useChoices(resource: Resource, custody: Custody): Choice[] {
  const { data: rows = [] } = useResources();
  const names = new Map(rows.map((row) => [row.id, row.name]));
  return placesFor(resource, rows, custody.places).map(({ row, whyNot }) => ({
    value: row.id,
    label: row.name,
    note: names.get(row.parent_id ?? "") ?? "",
    why: whyNot === null ? null : sentence(whyNot),
  }));
}

function CarryForm(props: { resource: Resource; custody: Custody; onClose: () => void }) {
  const { resource, custody, onClose } = props;
  const id = useId();
  const choices = useChoices(resource, custody);
  const carry = useCarry();
  const [to, setTo] = useState<string | null>(null);
  const [note, setNote] = useState("");
  const send = (): void => {
    if (to === null || resource.parent_id === null) return;
    const move = { resource_id: resource.id, from_id: resource.parent_id, to_id: to, note };
    carry.mutate(move, { onSuccess: onClose });
  };
  return (
    <AskForm
      name="carry"
      asked={carry}
      send={words.custody.send}
      why={to === null || !note.trim() ? words.custody.sayBoth : null}
      onSend={send}
      onCancel={onClose}
    >
      <div className="field">
        <label htmlFor={id}>{words.custody.place}</label>
        <Picker
          id={id}
          value={to}
          choices={choices}
          onChange={setTo}
          placeholder={words.custody.placeHint}
          testId="carry-place"
        />
      </div>
      <TextField
        label={words.custody.reason}
        value={note}
        onChange={setNote}
        help={words.custody.about}
        lines={2}
        testId="carry-reason"
      />
    </AskForm>
  );
}
