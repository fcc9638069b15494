/** What happened to things: operation, resource, change, transaction. */

import { Link } from "react-router";
import { changeWords } from "@/model/format";
import { capitalise, transactionState } from "@/model/states";
import type { LabEvent } from "@/model/wire";
import { Amount, Volume } from "./number";
import { StateChip, StateText } from "./state";
import { At } from "./time";

/** What changed, without the name that already stands beside it. */
function changeText(event: LabEvent): string {
  const text = event.summary || event.message;
  const name = event.subjects.find((subject) => text.startsWith(`${subject.name}: `))?.name;
  return changeWords(name ? text.slice(name.length + 2) : text);
}

function subjects(event: LabEvent): string {
  const source = event.subjects.find((subject) => subject.role === "source");
  const target = event.subjects.find((subject) => subject.role === "target");
  if (source && target) return `${source.name} → ${target.name}`;
  return event.subjects.map((subject) => subject.name).join(", ");
}

export function EventTable({ events, withRun = false }: { events: LabEvent[]; withRun?: boolean }) {
  return (
    <table className="evs">
      <colgroup>
        <col className="c-at" />
        <col className="c-op" />
        <col />
        <col className="c-change" />
        <col className="c-tx" />
        {withRun && <col className="c-run" />}
      </colgroup>
      <thead>
        <tr>
          <th>At</th>
          <th>Operation</th>
          <th>Resource</th>
          <th>Change</th>
          <th>Transaction</th>
          {withRun && <th>Run</th>}
        </tr>
      </thead>
      <tbody>
        {events.map((event) => (
          <Row key={`${event.seq}${event.transaction_id ?? ""}`} event={event} withRun={withRun} />
        ))}
      </tbody>
    </table>
  );
}

function Row({ event, withRun }: { event: LabEvent; withRun: boolean }) {
  const text = subjects(event);
  return (
    <tr
      data-testid="event-row"
      data-state={event.resolved ? "resolved" : event.state}
      data-operation={event.operation}
    >
      <td className="num m">
        <At at={event.at} seconds />
      </td>
      <td>{capitalise(event.operation)}</td>
      <td className={event.resolved ? "b" : "cut b"} title={text}>
        {text}
        {event.resolved && <End end={event.resolved} />}
      </td>
      <td className="num s cut" title={event.summary || event.message}>
        {event.amount_nl === null ? changeText(event) : <Volume nl={event.amount_nl} />}
        {event.amount_nl !== null && event.amount_ug !== null && (
          <>
            , <Amount nl={0} ug={event.amount_ug} />
          </>
        )}
      </td>
      <td>
        <Outcome event={event} />
      </td>
      {withRun && (
        <td>
          {event.run && (
            <Link className="num" to={`/runs/${event.run.id}`}>
              #{event.run.number}
            </Link>
          )}
        </td>
      )}
    </tr>
  );
}

/** How a doubt ended, by whom and when. */
function End({ end }: { end: NonNullable<LabEvent["resolved"]> }) {
  return (
    <div className="s t12 ended" data-testid="event-resolved" title={end.note}>
      {end.text}, <At at={end.at} seconds />
    </div>
  );
}

/** How the transaction stands; of a doubt that is over, how it ended. */
function Outcome({ event }: { event: LabEvent }) {
  if (event.resolved) return <StateText state={{ look: "ok", word: "Resolved" }} />;
  const state = transactionState(event.state);
  if (state.look === "doubt") return <StateChip state={state} />;
  return (
    <>
      <StateText state={state} />
      {event.verification === "unconfirmed" && <span className="s">, unconfirmed</span>}
    </>
  );
}
