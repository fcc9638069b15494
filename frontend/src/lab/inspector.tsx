/** A resource: what it holds, where it stands, what it is wired to, what happened to it. */

import { useState } from "react";
import { Link } from "react-router";
import { useResource, useResourceEvents, useResources } from "@/api/queries";
import { formatNumber, formatVolume, plain } from "@/model/format";
import { fillShare } from "@/model/tree";
import { wellMap } from "@/model/wells";
import type { Resource, ResourceRow } from "@/model/wire";
import { Empty } from "@/ui/card";
import { PartState } from "@/ui/pagestate";
import { EventTable } from "@/ui/events";
import { More, MoreOf } from "@/ui/more";
import { Glyph } from "@/ui/glyph";
import { Amount, FillBar } from "@/ui/number";
import { Conditions } from "./conditions";
import { Carry, OnItsWay } from "./custody";
import { TakeOff } from "./disconnect";
import { RecordReaction } from "./reaction";
import { Reserve, ReservedBy } from "./reservations";
import { TakeStock, type StockAsked } from "./stock";
import { WellGrid } from "./wellmap";
import { words } from "./words";

export function ResourceInspector({
  id,
  isShort = false,
  ask,
}: {
  id: string | null;
  isShort?: boolean;
  /** Where one may act on it: whether taking stock of it is asked for. */
  ask?: StockAsked;
}) {
  const resource = useResource(id);
  if (!id) return <Empty>{words.tree.pick}</Empty>;
  if (!resource.data) {
    return <PartState of="resource" error={resource.error} retry={resource.refetch} />;
  }
  return <Details resource={resource.data} isShort={isShort} ask={ask} />;
}

function Details(props: { resource: Resource; isShort: boolean; ask: StockAsked | undefined }) {
  const { resource, isShort, ask } = props;
  const hasStock = resource.holds_liquid || resource.is_quarantined;
  return (
    <div className="rdetail" data-testid="resource" data-resource={resource.id}>
      <header>
        <h2 tabIndex={-1}>{resource.name}</h2>
        <span className="m">{resource.kind_label}</span>
        <i className="sp" />
        {resource.holds_liquid && (
          <Link className="btn" to={`/lineage/${resource.id}`} data-testid="lineage-link">
            {words.tree.lineage}
          </Link>
        )}
        {ask && (
          <Link className="btn" to={`/files?resource=${resource.id}`} data-testid="files-link">
            {words.nav.files}
          </Link>
        )}
        {ask && resource.holds_liquid && (
          <RecordReaction key={`reaction ${resource.id}`} resource={resource} />
        )}
        {ask && resource.holds_liquid && resource.parent_id !== null && (
          <Carry key={`carry ${resource.id}`} resource={resource} />
        )}
        {ask && resource.parent_id !== null && (
          <Reserve key={`reserve ${resource.id}`} resource={resource} />
        )}
        {ask && hasStock && <TakeStock key={resource.id} resource={resource} ask={ask} />}
      </header>
      {resource.is_quarantined && (
        <p className="quar">
          <span className="chip" data-state="doubt">
            <Glyph look="doubt" />
            {words.tree.quarantined}
          </span>
          {words.tree.unknown}
        </p>
      )}
      <HeldBy resource={resource} />
      {ask && resource.holds_liquid && <OnItsWay key={`way ${resource.id}`} resource={resource} />}
      {ask && <ReservedBy key={`reserved ${resource.id}`} resource={resource} />}
      {resource.holds_liquid && <ContentsTable resource={resource} />}
      <WellsNow resource={resource} />
      <Facts resource={resource} mayAct={ask !== undefined} />
      {!isShort && (
        <>
          <Conditions resource={resource} />
          <h3 className="sub">Events</h3>
          <Events key={`events ${resource.id}`} resource={resource} />
        </>
      )}
    </div>
  );
}

/** What happened to it: the newest, and on request all of it. */
function Events({ resource }: { resource: Resource }) {
  const [isAll, setAll] = useState(false);
  const all = useResourceEvents(resource.id, isAll);
  const events = all.data ?? resource.events;
  if (!events.length) return <p className="help">Nothing has happened to it yet.</p>;
  return (
    <>
      <EventTable events={events} withRun />
      {resource.events_next !== null && !all.data && (
        <MoreOf
          count={events.length}
          what="events"
          isBusy={isAll && all.isPending}
          error={all.error}
          onMore={() => setAll(true)}
        />
      )}
      <More list={all} what="events" />
    </>
  );
}

function HeldBy({ resource }: { resource: Resource }) {
  return resource.held_by.map((hold) => (
    <p className="quar" key={hold.run_id} data-testid="held-by">
      <span className="chip" data-state="queued">
        <Glyph look="queued" />
        {words.tree.held}
      </span>
      <Link to={`/runs/${hold.run_id}`}>{words.tree.heldBy(hold)}</Link>
    </p>
  ));
}

function WellsNow({ resource }: { resource: Resource }) {
  const { data: rows = [] } = useResources();
  return <Wells resource={resource} rows={rows} />;
}

/** The map of a plate, also beside one of its wells. */
export function Wells({ resource, rows }: { resource: ResourceRow; rows: ResourceRow[] }) {
  const parent = rows.find((row) => row.id === resource.parent_id);
  const own = wellMap(rows, resource.id);
  const map = own ?? (parent ? wellMap(rows, parent.id) : null);
  if (!map) return null;
  return (
    <>
      <h3 className="sub">{own ? words.wells.title : `${parent?.name ?? ""}`}</h3>
      <WellGrid map={map} picked={resource.id} />
    </>
  );
}

function Facts(props: { resource: Resource; mayAct: boolean }) {
  const { resource, mayAct } = props;
  return (
    <dl className="kv">
      {resource.device && (
        <>
          <dt>Device</dt>
          <dd>
            <Link className="link" to={`/devices/${resource.device.id}`}>
              {resource.device.name}
            </Link>
          </dd>
        </>
      )}
      <dt>Key</dt>
      <dd className="mono">{resource.key}</dd>
      <dt>Id</dt>
      <dd className="mono">{resource.id}</dd>
      <dt>Place</dt>
      <dd>{place(resource.pose)}</dd>
      {resource.ports.map((port) => (
        <PortRow
          key={port.connection.connection_id}
          port={port}
          resource={resource}
          mayAct={mayAct}
        />
      ))}
    </dl>
  );
}

export function ContentsTable({ resource }: { resource: ResourceRow }) {
  const held = formatVolume(resource.volume_nl);
  const room = resource.capacity_nl === null ? null : formatVolume(resource.capacity_nl);
  return (
    <>
      <p className="fillline">
        <FillBar share={fillShare(resource)} />
        <span className="num">{room ? `${held} of ${room}` : `${held}, capacity not stated`}</span>
      </p>
      {resource.contents.length > 0 && (
        <table>
          <thead>
            <tr>
              <th>Material</th>
              <th>Lot</th>
              <th className="r">Amount</th>
            </tr>
          </thead>
          <tbody>
            {resource.contents.map((content) => (
              <tr key={content.lot_id}>
                <td className="b">{content.material}</td>
                <td className="mono s">{content.lot}</td>
                <td className="r">
                  <Amount nl={content.amount_nl} ug={content.amount_ug} />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </>
  );
}

function PortRow(props: { port: Resource["ports"][number]; resource: Resource; mayAct: boolean }) {
  const { port, resource, mayAct } = props;
  return (
    <>
      <dt>Port {port.port}</dt>
      <dd>
        {port.to ? (
          <Link className="link" to={`/lab?sel=${port.to.id}`}>
            {port.to.name}, port {port.to.port}
          </Link>
        ) : (
          "closed"
        )}{" "}
        <span className="m">{port.medium}</span>{" "}
        {mayAct && <TakeOff resource={resource} port={port} />}
      </dd>
    </>
  );
}

function place(pose: Record<string, unknown> | null): string {
  if (!pose) return "unknown";
  const axis = (name: string): string | null => {
    const value = pose[`${name}_mm`] ?? pose[name];
    return typeof value === "number" ? formatNumber(value, 0) : null;
  };
  const axes = ["x", "y", "z"].map(axis);
  return axes.every((value) => value !== null) ? `${axes.join(" · ")} mm` : plain(pose);
}
