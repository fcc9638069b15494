/** A ticket: what two stories differ in, and its end. */

import { useState } from "react";
import { Link } from "react-router";
import { useCloseTicket } from "@/api/commands";
import { useTicket } from "@/api/queries";
import { formatFact, plain, sentence } from "@/model/format";
import type { Ticket } from "@/model/wire";
import { Loaded } from "@/ui/card";
import { AskForm } from "@/ui/askform";
import { Button, Dialog, TextField } from "@/ui/controls";
import { At } from "@/ui/time";
import { words } from "./words";

export function TicketDialog({ id, onClose }: { id: string; onClose: () => void }) {
  const ticket = useTicket(id);
  return (
    <Dialog title={words.ticket.title} isOpen onClose={onClose} size={560} testId="ticket-dialog">
      <Loaded source={ticket} what="this ticket">
        {(found) => <TicketText ticket={found} />}
      </Loaded>
    </Dialog>
  );
}

function TicketText({ ticket }: { ticket: Ticket }) {
  const [title = "", ...rest] = ticket.message.split(": ");
  return (
    <div className="sheet" data-testid="ticket" data-ticket={ticket.id}>
      <p className="b">{sentence(title)}</p>
      {rest.length > 0 && <p className="s">{sentence(rest.join(": "))}</p>}
      <dl className="kv">
        <dt>Code</dt>
        <dd className="mono">{ticket.code}</dd>
        <dt>Opened</dt>
        <dd>
          <At at={ticket.opened_at} seconds />
        </dd>
        {ticket.host && (
          <>
            <dt>Edge host</dt>
            <dd>{ticket.host.name}</dd>
          </>
        )}
        <Concerned ticket={ticket} />
        <Leads to={ticket.detail.run_id} at="runs" label="Run" />
        <Leads to={ticket.detail.device_id} at="devices" label="Device" />
        <Detail detail={ticket.detail} />
      </dl>
      <Stories detail={ticket.detail} />
      {ticket.closed_at === null ? <Closing ticket={ticket} /> : <Closed ticket={ticket} />}
    </div>
  );
}

/** The resources, unless it concerns the lab as a whole. */
function Concerned({ ticket }: { ticket: Ticket }) {
  if (!ticket.detail.transaction_id) return null;
  return (
    <>
      <dt>Concerns</dt>
      <dd>
        {ticket.resources.map((row) => (
          <span key={row.id} className="concerned">
            <Link className="link" to={`/lab?sel=${row.id}`}>
              {row.name}
            </Link>
            {row.is_quarantined && <span className="m"> {words.tree.quarantined}</span>}{" "}
            {ticket.closed_at === null && (
              <Link className="link" to={`/lab?sel=${row.id}&stock=1`}>
                {words.stock.button}
              </Link>
            )}
          </span>
        ))}
      </dd>
    </>
  );
}

function Leads({ to, at, label }: { to: unknown; at: string; label: string }) {
  if (typeof to !== "string") return null;
  return (
    <>
      <dt>{label}</dt>
      <dd>
        <Link className="link" to={`/${at}/${to}`}>
          Open
        </Link>
      </dd>
    </>
  );
}

const STORIES = ["edge", "server"];

/** Shown as what they lead to. */
const LINKED = ["run_id", "host_id", "device_id"];

function Detail({ detail }: { detail: Ticket["detail"] }) {
  return Object.entries(detail)
    .filter(([name]) => !STORIES.includes(name) && !LINKED.includes(name))
    .map(([name, value]) => {
      const [label, text] = formatFact(name, value);
      return (
        <div key={name} className="kvrow">
          <dt>{label}</dt>
          <dd className="mono">{text}</dd>
        </div>
      );
    });
}

/** Where edge and server differ, field by field. */
function Stories({ detail }: { detail: Ticket["detail"] }) {
  const edge = asObject(detail.edge);
  const server = asObject(detail.server);
  if (!edge || !server) return null;
  const names = [...new Set([...Object.keys(edge), ...Object.keys(server)])].filter(
    (name) => JSON.stringify(edge[name]) !== JSON.stringify(server[name]),
  );
  return (
    <table data-testid="ticket-stories">
      <thead>
        <tr>
          <th>Differs</th>
          <th>Edge host says</th>
          <th>Server says</th>
        </tr>
      </thead>
      <tbody>
        {names.map((name) => (
          <tr key={name}>
            <td className="b">{formatFact(name, null)[0]}</td>
            <td className="mono s">{plain(edge[name])}</td>
            <td className="mono s">{plain(server[name])}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function asObject(value: unknown): Record<string, unknown> | null {
  return typeof value === "object" && value !== null ? (value as Record<string, unknown>) : null;
}

function Closed({ ticket }: { ticket: Ticket }) {
  return (
    <p className="s" role="status" data-testid="ticket-closed">
      Closed by {ticket.closed_by ?? "nobody named"}, <At at={ticket.closed_at} seconds />
    </p>
  );
}

function Closing({ ticket }: { ticket: Ticket }) {
  const [isAsking, setAsking] = useState(false);
  const [reason, setReason] = useState("");
  const close = useCloseTicket(ticket.id);
  if (!isAsking) {
    return (
      <div className="acts">
        <Button
          testId="ticket-close"
          why={ticket.can_close ? null : words.ticket.mayNot}
          onClick={() => setAsking(true)}
        >
          {words.ticket.close}
        </Button>
      </div>
    );
  }
  return (
    <AskForm
      name="ticket"
      asked={close}
      send={words.ticket.send}
      why={reason.trim() ? null : words.ticket.reasonFirst}
      onSend={() => close.mutate(reason.trim())}
      onCancel={() => setAsking(false)}
    >
      <TextField
        label={words.ticket.reason}
        value={reason}
        onChange={setReason}
        help={words.ticket.reasonHelp}
        lines={2}
        testId="ticket-reason"
      />
    </AskForm>
  );
}
