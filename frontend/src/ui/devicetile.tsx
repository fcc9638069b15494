/** A device at a glance: readings with their age, setpoints apart from readings. */

import { Link } from "react-router";
import { readingText } from "@/model/format";
import { haltState, jobState, linkState, type State } from "@/model/states";
import { isSetpoint } from "@/model/telemetry";
import type { DeviceRow, Reading } from "@/model/wire";
import { Icon, iconOf } from "./icons";
import { ReadingValue } from "./number";
import { StateChip, StateGlyph } from "./state";
import { Age } from "./time";

/** State of a device for its tile: its link first, then whether it works. */
export function deviceState(device: DeviceRow): State {
  if (device.link !== "online") {
    const state = linkState(device.link);
    return device.is_halt_owed ? { ...state, word: `${state.word}, to be halted` } : state;
  }
  if (device.job?.state === "in_doubt") return jobState("in_doubt");
  if (device.is_halt_owed) return { look: "paused", word: "To be halted" };
  if (device.halt) return haltState(device.halt);
  return device.job ? { look: "running", word: "Busy" } : { look: "idle", word: "Idle" };
}

/** Readings worth a large figure: one of each unit, setpoints never. */
export function mainReadings(readings: readonly Reading[]): Reading[] {
  const measured = readings.filter((r) => !isSetpoint(r.status));
  const figures = measured.filter((r) => typeof r.value === "number" && r.unit !== "");
  const distinct = figures.filter((r, at) => figures.findIndex((o) => o.unit === r.unit) === at);
  return (distinct.length ? distinct : measured).slice(0, 2);
}

export function BenchGrid({ devices }: { devices: DeviceRow[] }) {
  return (
    <div className="devs">
      {devices.map((device) => (
        <DeviceTile key={device.id} device={device} />
      ))}
    </div>
  );
}

function DeviceTile({ device }: { device: DeviceRow }) {
  const state = deviceState(device);
  const isAway = device.link !== "online";
  const shown = mainReadings(device.readings);
  const times = shown.map((reading) => reading.at_s).filter((at) => at !== null);
  return (
    <Link
      className={`dev ${isAway ? "off" : ""}`}
      to={`/devices/${device.id}`}
      data-testid="device-tile"
      data-state={device.link}
    >
      <span className="dh">
        <Icon name={iconOf(`${device.role} ${device.kind_label}`)} />
        <b className="b cut">{device.name}</b>
        <i className="sp" />
        {isAway ? <StateChip state={state} /> : <StateGlyph state={state} />}
      </span>
      <span className="dv">
        {shown.length === 0 && "–"}
        {shown.map((reading) => (
          <ReadingValue key={reading.status} value={reading.value} unit={reading.unit} />
        ))}
      </span>
      <span className="ds t12 m">
        <span>
          {device.job?.sentence ?? setpointText(device) ?? portText(device) ?? device.kind_label}
        </span>
        {times.length > 0 && <Age at_s={Math.min(...times)} />}
      </span>
    </Link>
  );
}

/** Where a valve stands. */
function portText(device: DeviceRow): string | null {
  const port = device.readings.find((r) => r.status === "port_index");
  return typeof port?.value === "number" ? `port ${port.value}` : null;
}

function setpointText(device: DeviceRow): string | null {
  const set = device.readings.filter((r) => isSetpoint(r.status) && r.value !== null);
  if (!set.length) return null;
  return `set ${set.map((r) => readingText(r.value, r.unit)).join(", ")}`;
}
