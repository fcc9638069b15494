/** What is known of a resource: what is declared, what was set, what is measured, and since when. */

import { useDevices, useResources } from "@/api/queries";
import { formatFact, readingText } from "@/model/format";
import type { DeviceRow, Reading, Resource, ResourceRow } from "@/model/wire";
import { Link } from "react-router";
import { At } from "@/ui/time";
import { words } from "./words";

export function Conditions({ resource }: { resource: Resource }) {
  const declared = Object.entries(resource.config);
  return (
    <>
      {declared.length > 0 && (
        <section data-testid="declared">
          <h3 className="sub">{words.conditions.declared}</h3>
          <p className="help">{words.conditions.declaredHelp}</p>
          <dl className="kv">
            {declared.map(([name, value]) => {
              const [label, text] = formatFact(name, value);
              return <Row key={name} label={label} value={text} />;
            })}
          </dl>
        </section>
      )}
      <Known resource={resource} />
    </>
  );
}

/** What acts have set or read of it, and what the device reads that it stands at. */
function Known({ resource }: { resource: Resource }) {
  const rows = useResources().data ?? [];
  const devices = useDevices().data ?? [];
  const device = deviceAt(resource, rows, devices);
  const readings = device?.readings.filter(isCondition) ?? [];
  const data = Object.entries(resource.data);
  if (!resource.holds_liquid && !data.length && !readings.length) return null;
  return (
    <section data-testid="known">
      <h3 className="sub">{words.conditions.known}</h3>
      {!data.length && !readings.length && <p className="help">{words.conditions.nothing}</p>}
      <dl className="kv">
        {data.map(([name, value]) => {
          const [label, text] = formatFact(name, value);
          const told = resource.data_told[name];
          return (
            <Row key={name} label={label} value={text}>
              {told && (
                <>
                  {words.conditions.how(told.how, told.job_id !== null)} <At at={told.at} seconds />
                </>
              )}
            </Row>
          );
        })}
        {device &&
          readings.map((one) => (
            <Row key={one.status} label={one.label} value={readingText(one.value, one.unit)}>
              {words.conditions.readBy}{" "}
              <Link className="link" to={`/devices/${device.id}`}>
                {device.name}
              </Link>{" "}
              <At at={one.at_s === null ? null : new Date(one.at_s * 1000).toISOString()} seconds />
            </Row>
          ))}
      </dl>
    </section>
  );
}

function Row(props: { label: string; value: string; children?: React.ReactNode }) {
  return (
    <>
      <dt>{props.label}</dt>
      <dd>
        {props.value} {props.children && <span className="m">{props.children}</span>}
      </dd>
    </>
  );
}

/** The device that it is, or that it stands at. */
function deviceAt(
  resource: ResourceRow,
  rows: ResourceRow[],
  devices: DeviceRow[],
): DeviceRow | undefined {
  for (let at: ResourceRow | undefined = resource; at;) {
    const id = at.device?.id;
    if (id) return devices.find((one) => one.id === id);
    const above: string | null = at.parent_id;
    at = rows.find((row) => row.id === above);
  }
  return undefined;
}

function isCondition({ status }: Reading): boolean {
  return /^(\w+_)?(temperature|speed|pressure)(_setpoint)?_(c|rpm|kpa)$/.test(status);
}
