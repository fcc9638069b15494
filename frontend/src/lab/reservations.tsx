/** Who has reserved a resource, in their order; reserving it, and ending that before its time. */

import { useState } from "react";
import { useEndReservation, useReserve } from "@/api/commands";
import { useTopics } from "@/api/live";
import { useReservations } from "@/api/queries";
import { readMinutes, SPANS, whyNotReserved } from "@/model/reserving";
import type { Reservation, Reservations, Resource } from "@/model/wire";
import { Failed } from "@/ui/card";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, Refused, Segments, TextField } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { At } from "@/ui/time";
import { words } from "./words";

/** The line before a resource; nothing where nobody has reserved it. */
export function ReservedBy({ resource }: { resource: Resource }) {
  const line = useReservations(resource.id);
  useTopics("events");
  if (line.error)
    return <Failed what="who has reserved it" error={line.error} retry={line.refetch} />;
  const rows = line.data?.reservations ?? [];
  if (!rows.length) return null;
  return (
    <section className="journey" data-testid="reserved">
      {rows.map((row, place) => (
        <Turn key={row.id} row={row} isFirst={place === 0} resource={resource} />
      ))}
    </section>
  );
}

function Turn(props: { row: Reservation; isFirst: boolean; resource: Resource }) {
  const { row, isFirst, resource } = props;
  const end = useEndReservation();
  return (
    <>
      <p className="quar" data-testid="reservation">
        <span className="chip" data-state="queued">
          <Glyph look="queued" />
          {isFirst ? words.reserve.reserved : words.reserve.then}
        </span>
        <span>
          {row.resource.id !== resource.id && `${row.resource.name} `}
          {words.reserve.by} <b>{row.is_own ? words.reserve.you : row.holder}</b>{" "}
          {words.reserve.until} <At at={row.expires_at} />: {row.reason}
        </span>
        {row.may_end && (
          <Button
            testId="reservation-end"
            disabled={end.isPending}
            onClick={() => end.mutate(row.id)}
          >
            {words.reserve.end}
          </Button>
        )}
      </p>
      <Refused error={end.error} />
    </>
  );
}

/** The button that reserves a resource, and its dialog. */
export function Reserve({ resource }: { resource: Resource }) {
  const line = useReservations(resource.id);
  const [isOpen, setIsOpen] = useState(false);
  const close = (): void => setIsOpen(false);
  return (
    <>
      <Button testId="reserve" why={whyNot(line.data)} onClick={() => setIsOpen(true)}>
        {words.reserve.button}
      </Button>
      <Dialog
        title={`${words.reserve.title} ${resource.name}`}
        isOpen={isOpen}
        onClose={close}
        size={480}
        testId="reserve-dialog"
      >
        {line.data && <ReserveForm resource={resource} line={line.data} onClose={close} />}
      </Dialog>
    </>
  );
}

function whyNot(line: Reservations | undefined): string | null {
  if (!line) return "Loading…";
  return line.is_allowed ? null : words.custody.mayNot;
}

function ReserveForm(props: { resource: Resource; line: Reservations; onClose: () => void }) {
  const { resource, line, onClose } = props;
  const reserve = useReserve();
  const [span, setSpan] = useState<string>("60");
  const [hours, setHours] = useState("");
  const [reason, setReason] = useState("");
  const minutes = readMinutes(span, hours);
  const others = line.reservations.filter((row) => !row.is_own);
  const send = (): void => {
    if (minutes === null) return;
    const wanted = { resource_ids: [resource.id], minutes, reason };
    reserve.mutate(wanted, { onSuccess: onClose });
  };
  return (
    <AskForm
      name="reserve"
      asked={reserve}
      send={words.reserve.send}
      why={whyNotReserved(minutes, reason)}
      onSend={send}
      onCancel={onClose}
    >
      <HowLong span={span} setSpan={setSpan} hours={hours} setHours={setHours} />
      <TextField
        label={words.reserve.reason}
        value={reason}
        onChange={setReason}
        help={words.reserve.about}
        lines={2}
        testId="reserve-reason"
      />
      {others.length > 0 && <p className="help">{words.reserve.behind(others.length)}</p>}
    </AskForm>
  );
}

function HowLong(props: {
  span: string;
  setSpan: (span: string) => void;
  hours: string;
  setHours: (hours: string) => void;
}) {
  return (
    <>
      <div className="field">
        <span className="caption">{words.reserve.howLong}</span>
        <Segments
          label={words.reserve.howLong}
          value={props.span}
          options={SPANS}
          onChange={props.setSpan}
        />
      </div>
      {props.span === "other" && (
        <TextField
          label={words.reserve.hours}
          value={props.hours}
          onChange={props.setHours}
          testId="reserve-hours"
        />
      )}
    </>
  );
}
