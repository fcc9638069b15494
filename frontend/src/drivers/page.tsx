/** One version of a driver: its approval, its devices, what changed, its text, its forms. */

import "./drivers.css";
import { useState } from "react";
import { Link, useParams } from "react-router";
import { useDriver, useDrivers } from "@/api/drivers";
import { useTopics } from "@/api/live";
import { useSession } from "@/api/queries";
import { driverState, newestFirst } from "@/model/drivers";
import { formatDigest } from "@/model/format";
import type { DriverDetail, DriverRow } from "@/model/wiredrivers";
import { AsOf, Card, Empty } from "@/ui/card";
import { Button } from "@/ui/controls";
import { StateChip } from "@/ui/state";
import { At } from "@/ui/time";
import { PageState } from "@/ui/pagestate";
import { BringDriver } from "./bring";
import { Forms } from "./forms";
import { Places } from "./places";
import { Answer, Withdraw } from "./request";
import { Changes, Source } from "./source";
import { words } from "./words";

export function DriverPage() {
  const { id = "" } = useParams();
  const driver = useDriver(id);
  useTopics("drivers", "devices", "hosts");
  if (driver.data)
    return <Details key={id} driver={driver.data} error={driver.error} at={driver.dataUpdatedAt} />;
  return <PageState of="driver" error={driver.error} retry={driver.refetch} />;
}

function Details({ driver, error, at }: { driver: DriverDetail; error: Error | null; at: number }) {
  const rows = useDrivers().data ?? [];
  const versions = rows.filter((row) => row.module === driver.module);
  const [isSeen, setSeen] = useState(false);
  const [isBringing, setBringing] = useState(false);
  const mayBring = useSession().data?.user?.lab_permissions.includes("submit") ?? false;
  const see = (): void => setSeen(true);
  return (
    <div className="wrap devpage drivers" data-testid="driver" data-state={driver.state}>
      <div className="hd wrapping">
        <Link className="crumb" to="/drivers">
          {words.title}
        </Link>
        <span className="m">/</span>
        <h1 className="drivername">{driver.class_name}</h1>
        <span className="mono s" title={driver.digest}>
          {formatDigest(driver.digest)}
        </span>
        <StateChip state={driverState(driver.state)} />
        <i className="sp" />
        <Link className="btn" to={`/drivers/${driver.id}/try`} data-testid="try-open">
          {words.trying.open}
        </Link>
        <Button
          testId="bring-version"
          why={mayBring ? null : words.mayNotBring}
          onClick={() => setBringing(true)}
        >
          {words.bringVersion}
        </Button>
      </div>
      {error && <AsOf at={at} why={error.message} />}
      <div className="col">
        {driver.state === "proposed" && <Answer driver={driver} isSeen={isSeen} />}
        <Places driver={driver} versions={versions} />
        {driver.can.read ? (
          <>
            <Changes driver={driver} versions={versions} onSeen={see} />
            <Source driver={driver} onSeen={see} />
          </>
        ) : (
          <Card title={words.source.title} testId="driver-hidden">
            <Empty>{words.source.hidden}</Empty>
          </Card>
        )}
      </div>
      <aside className="col">
        <Facts driver={driver} />
        <Versions driver={driver} versions={versions} />
        <Card title={words.forms.title} note={words.forms.note}>
          <div className="padded">
            <Forms about={driver} />
          </div>
        </Card>
      </aside>
      <BringDriver isOpen={isBringing} onClose={() => setBringing(false)} module={driver.module} />
    </div>
  );
}

function Facts({ driver }: { driver: DriverDetail }) {
  const { request } = driver;
  return (
    <Card title="Version" testId="driver-facts">
      <dl className="kv inset">
        <dt>Module</dt>
        <dd className="mono">{driver.module}</dd>
        <dt>Digest</dt>
        <dd className="mono long">{driver.digest}</dd>
        <dt>From</dt>
        <dd>{driver.origin === "release" ? "the release" : driver.proposed_by}</dd>
        {driver.proposed_at && (
          <>
            <dt>Brought</dt>
            <dd>
              <At at={driver.proposed_at} />
            </dd>
          </>
        )}
        {driver.note && (
          <>
            <dt>New in it</dt>
            <dd>{driver.note}</dd>
          </>
        )}
        {request?.decision && (
          <>
            <dt>{request.decision.is_approved ? "Approved" : "Rejected"}</dt>
            <dd>
              {request.decision.printed_name}, <At at={request.decision.at} />
              {request.decision.comment && <span className="s">: {request.decision.comment}</span>}
            </dd>
          </>
        )}
        <dt>Speaks</dt>
        <dd>{driver.protocol || "–"}</dd>
        <dt>Safe state</dt>
        <dd>{driver.safe_state || "–"}</dd>
        <dt>Quality</dt>
        <dd>{driver.quality || "–"}</dd>
      </dl>
      {driver.doc && <p className="help note">{driver.doc.split("\n")[0]}</p>}
      <Withdraw driver={driver} />
    </Card>
  );
}

function Versions({ driver, versions }: { driver: DriverDetail; versions: DriverRow[] }) {
  return (
    <Card title="Versions" note={String(versions.length)} testId="driver-versions">
      <ol className="versionlist">
        {newestFirst(versions).map((row) => (
          <li key={row.id} data-state={row.state}>
            <Link
              to={`/drivers/${row.id}`}
              aria-current={row.id === driver.id ? "page" : undefined}
              data-testid="driver-version"
            >
              <span className="mono">{formatDigest(row.digest)}</span>
              <span className="s">
                <At at={row.proposed_at ?? row.read_at} />
              </span>
              <i className="sp" />
              {row.state !== "approved" && <StateChip state={driverState(row.state)} />}
              {row.devices.length > 0 && (
                <span className="t12 m">{row.devices.map((one) => one.name).join(", ")}</span>
              )}
            </Link>
            {row.note && <p className="help">{row.note}</p>}
          </li>
        ))}
      </ol>
    </Card>
  );
}
