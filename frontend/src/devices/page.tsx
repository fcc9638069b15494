/** One device: readings with their age, curves, what it can do, what drives it. */

import { Link, useParams } from "react-router";
import { useTopics } from "@/api/live";
import { useDevice } from "@/api/queries";
import { useLiveSamples } from "@/api/telemetry";
import { formatDigest, plain, formatFact } from "@/model/format";
import { capitalise } from "@/model/states";
import { isSetpoint, labelOf } from "@/model/telemetry";
import type { Device, Reading, Sample } from "@/model/wire";
import { AsOf, Card, Empty } from "@/ui/card";
import { deviceState } from "@/ui/devicetile";
import { Icon, iconOf } from "@/ui/icons";
import { ReadingValue } from "@/ui/number";
import { StateChip } from "@/ui/state";
import { Age, At } from "@/ui/time";
import { PageState } from "@/ui/pagestate";
import { Calibrations } from "./calibration";
import { History } from "./history";
import { Photo } from "./photo";
import { ShowItself } from "./showitself";
import { StopDevice } from "./stop";
import { words } from "./words";

/** Of these, the newest of each status is sure to be one. */
const MOST_NEW = 500;

export function DevicePage() {
  const { id = "" } = useParams();
  const device = useDevice(id);
  useTopics("devices", "hosts", "runs");
  if (!device.data) {
    return <PageState of="device" error={device.error} retry={device.refetch} />;
  }
  const data = device.data;
  return (
    <div className="wrap devpage" data-testid="device" data-state={data.link}>
      <div className="hd wrapping">
        <Link className="crumb" to="/devices">
          {words.title}
        </Link>
        <span className="m">/</span>
        <Icon name={iconOf(`${data.role} ${data.kind_label}`)} />
        <h1>{data.name}</h1>
        <StateChip state={deviceState(data)} />
        <span className="s">
          {data.kind_label}
          {data.host && ` on ${data.host.name}`}
        </span>
        <i className="sp" />
        {data.job && (
          <Link className="link" to={`/runs/${data.job.run_id}?job=${data.job.id}`}>
            Run #{data.job.run_number}: {data.job.sentence}
          </Link>
        )}
      </div>
      {device.error && <AsOf at={device.dataUpdatedAt} why={device.error.message} />}
      {data.is_halt_owed && (
        <p className="as-of t12" role="status" data-testid="halt-owed">
          {words.haltOwed}
        </p>
      )}
      <div className="col">
        <Calibrations key={`calibrations of ${data.id}`} device={data} />
        <History key={data.id} device={data} />
        <Actions device={data} />
      </div>
      <aside className="col">
        <Readings deviceId={data.id} readings={data.readings} isAway={data.link !== "online"} />
        <Photo key={`photo of ${data.id}`} device={data} />
        <StopDevice key={`stop of ${data.id}`} device={data} />
        <ShowItself key={`name of ${data.id}`} device={data} />
        <Driver device={data} />
        <Settings device={data} />
      </aside>
    </div>
  );
}

function Readings(props: { deviceId: string; readings: Reading[]; isAway: boolean }) {
  const { deviceId, isAway } = props;
  const readings = newest(props.readings, useLiveSamples(deviceId, true));
  if (!readings.length) {
    return (
      <Card title="Readings">
        <Empty>{words.noReadings}</Empty>
      </Card>
    );
  }
  const measured = readings.filter((reading) => !isSetpoint(reading.status));
  const set = readings.filter((reading) => isSetpoint(reading.status));
  const statuses = readings.map((reading) => reading.status);
  return (
    <Card
      title="Readings"
      note={isAway ? "last known" : "measured"}
      className={isAway ? "stale" : ""}
    >
      <dl className="readings">
        {measured.map((reading) => (
          <ReadingRow
            key={reading.status}
            reading={reading}
            label={labelOf(reading.status, reading.label, statuses)}
          />
        ))}
      </dl>
      {set.length > 0 && (
        <>
          <h3 className="sub">Setpoints</h3>
          <dl className="readings">
            {set.map((reading) => (
              <ReadingRow key={reading.status} reading={reading} label={reading.label} />
            ))}
          </dl>
        </>
      )}
    </Card>
  );
}

/** Readings as they were fetched, or what came since. */
function newest(readings: Reading[], live: readonly Sample[]): Reading[] {
  const last = new Map(live.slice(-MOST_NEW).map((sample) => [sample[0], sample]));
  return readings.map((reading) => {
    const came = last.get(reading.status);
    return came && came[1] > (reading.at_s ?? 0)
      ? { ...reading, at_s: came[1], value: came[2] }
      : reading;
  });
}

function ReadingRow({ reading, label }: { reading: Reading; label: string }) {
  return (
    <div data-testid={`reading-${reading.status}`}>
      <dt className="s">{label}</dt>
      <dd className="b">
        <ReadingValue value={reading.value} unit={reading.unit} />
      </dd>
      <dd className="t12 m r">
        <Age at_s={reading.at_s} />
      </dd>
    </div>
  );
}

function Actions({ device }: { device: Device }) {
  return (
    <Card title="Actions" note="as the driver declares them">
      {device.actions.length === 0 && <Empty>It only tells; it does nothing.</Empty>}
      <dl className="deflist">
        {device.actions.map((action) => (
          <div key={action.name}>
            <dt className="b">{action.label}</dt>
            <dd className="s">
              {action.doc}
              <span className="t12 m">
                {Object.entries(action.schema.properties ?? {})
                  .map(([name, schema]) => {
                    const unit = schema["x-unit"] ? ` in ${schema["x-unit"]}` : "";
                    return `${schema["x-label"] ?? name}${unit}`;
                  })
                  .join(" · ")}
              </span>
            </dd>
          </div>
        ))}
      </dl>
    </Card>
  );
}

function Driver({ device }: { device: Device }) {
  const { driver } = device;
  if (!driver) return null;
  return (
    <Card title="Driver">
      <dl className="kv inset">
        <dt>Class</dt>
        <dd>
          <Link className="link mono" to={`/drivers/${driver.version_id}`} data-testid="to-driver">
            {driver.class_name}
          </Link>
        </dd>
        <dt>Speaks</dt>
        <dd>{driver.protocol || "–"}</dd>
        <dt>Quality</dt>
        <dd>{driver.quality || "–"}</dd>
        <dt>Source</dt>
        <dd className="mono" title={driver.digest}>
          {formatDigest(driver.digest)}
        </dd>
        <dt>Serving</dt>
        <dd data-testid="device-serving">
          <Serving device={device} />
        </dd>
      </dl>
      {driver.doc && <p className="help note">{driver.doc.split("\n")[0]}</p>}
    </Card>
  );
}

/** Which version of the driver runs on which host now, as the host said it last. */
function Serving({ device }: { device: Device }) {
  const serving = device.driver?.serving;
  if (!serving)
    return <>{device.host?.name ?? "Its host"} has not said that a version serves it.</>;
  return (
    <>
      {serving.is_present ? (
        "This version"
      ) : (
        <span className="mono">{formatDigest(serving.digest)}</span>
      )}{" "}
      on {device.host?.name}, since <At at={serving.at} />
      {!serving.is_present && ": the version before, until the change is through"}
    </>
  );
}

function Settings({ device }: { device: Device }) {
  const rows = Object.entries(device.config);
  return (
    <Card title="Settings">
      <dl className="kv inset">
        <dt>State</dt>
        <dd>{capitalise(device.state)}</dd>
        {device.nodes.map((node) => (
          <NodeRow key={`${node.role}${node.id}`} node={node} />
        ))}
        {rows.map(([name, value]) => (
          <SettingRow key={name} name={name} value={value} />
        ))}
        <dt>Transport</dt>
        <dd className="mono">{transportText(device.transport)}</dd>
      </dl>
    </Card>
  );
}

/** Kind and address of a transport, however the lab file writes them. */
function transportText(transport: unknown): string {
  if (!transport || typeof transport !== "object") return plain(transport);
  return Object.values(transport).map(plain).join(" · ");
}

function NodeRow({ node }: { node: Device["nodes"][number] }) {
  return (
    <>
      <dt>{capitalise(node.role)}</dt>
      <dd>
        <Link className="link" to={`/lab?sel=${node.id}`}>
          {node.name}
        </Link>
      </dd>
    </>
  );
}

function SettingRow({ name, value }: { name: string; value: unknown }) {
  const [label, text] = formatFact(name, value);
  return (
    <>
      <dt title={name}>{label}</dt>
      <dd>{text}</dd>
    </>
  );
}
