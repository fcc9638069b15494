/** Every device: its link, what it does, what it tells and how old that is. */

import { Link } from "react-router";
import { useTopics } from "@/api/live";
import { useDevices, useHosts } from "@/api/queries";
import { toSeconds } from "@/model/format";
import { sessionState } from "@/model/hosts";
import type { DeviceRow, HostRow } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { deviceState, mainReadings } from "@/ui/devicetile";
import { Icon, iconOf } from "@/ui/icons";
import { ReadingValue } from "@/ui/number";
import { StateChip } from "@/ui/state";
import { Age } from "@/ui/time";
import { words } from "./words";

export function DevicesPage() {
  const devices = useDevices();
  const hosts = useHosts();
  useTopics("devices", "hosts");
  return (
    <div className="wrap" data-testid="devices">
      <div className="hd">
        <h1>{words.title}</h1>
      </div>
      <Card title={words.title} note={devices.data ? String(devices.data.length) : null}>
        <Loaded source={devices} what="devices">
          {(rows) => (rows.length ? <DeviceTable rows={rows} /> : <Empty>{words.none}</Empty>)}
        </Loaded>
      </Card>
      <Card title="Edge hosts">
        <Loaded source={hosts} what="edge hosts">
          {(rows) => (rows.length ? <HostTable rows={rows} /> : <Empty>No host enrolled.</Empty>)}
        </Loaded>
      </Card>
    </div>
  );
}

function DeviceTable({ rows }: { rows: DeviceRow[] }) {
  return (
    <table>
      <thead>
        <tr>
          <th>Device</th>
          <th className="wide">Kind</th>
          <th className="wide">Host</th>
          <th>State</th>
          <th className="r">Reading</th>
          <th className="wide r">Age</th>
          <th className="wide">Does</th>
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => {
          const shown = mainReadings(row.readings);
          return (
            <tr key={row.id} data-testid="device-row" data-state={row.link}>
              <td>
                <Link className="named b" to={`/devices/${row.id}`}>
                  <Icon name={iconOf(`${row.role} ${row.kind_label}`)} />
                  {row.name}
                </Link>
              </td>
              <td className="wide s">{row.kind_label}</td>
              <td className="wide s">{row.host?.name ?? "–"}</td>
              <td>
                <StateChip state={deviceState(row)} />
              </td>
              <td className={`r ${row.link === "online" ? "" : "m"}`}>
                <span className="values">
                  {shown.map((r) => (
                    <ReadingValue key={r.status} value={r.value} unit={r.unit} />
                  ))}
                  {shown.length === 0 && "–"}
                </span>
              </td>
              <td className="wide r m">{shown[0] ? <Age at_s={shown[0].at_s} /> : "–"}</td>
              <td className="wide s">
                {row.job ? (
                  <Link to={`/runs/${row.job.run_id}?job=${row.job.id}`}>
                    <span className="num">#{row.job.run_number}</span> {row.job.sentence}
                  </Link>
                ) : (
                  <span className="m">nothing</span>
                )}
              </td>
            </tr>
          );
        })}
      </tbody>
    </table>
  );
}

function HostTable({ rows }: { rows: HostRow[] }) {
  return (
    <table>
      <thead>
        <tr>
          <th>Host</th>
          <th>State</th>
          <th className="r wide">Last heard</th>
          <th className="r">Devices</th>
          <th className="r">Journal not synced</th>
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => (
          <tr key={row.id} data-testid="host-row" data-state={row.state}>
            <td>
              <Link className="b" to={`/hosts/${row.id}`}>
                {row.name}
              </Link>
            </td>
            <td>
              <StateChip state={sessionState(row.state)} />
            </td>
            <td className="r m wide">
              <Age at_s={toSeconds(row.last_seen_at)} />
            </td>
            <td className="r num">{row.devices_count}</td>
            <td className="r num">{row.journal_lag}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
