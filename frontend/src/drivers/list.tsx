/** Every driver with its versions, who uses it, and what waits for a second person. */

import "./drivers.css";
import { useRef, useState, type DragEvent } from "react";
import { Link } from "react-router";
import { useDrivers } from "@/api/drivers";
import { useTopics } from "@/api/live";
import { useSession } from "@/api/queries";
import { driverState, groupDrivers, isShown, type DriverGroup, type Filter } from "@/model/drivers";
import { formatDigest } from "@/model/format";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button, Segments } from "@/ui/controls";
import { StateChip } from "@/ui/state";
import { At } from "@/ui/time";
import { BringDriver } from "./bring";
import { words } from "./words";

const FILTERS = [
  { value: "all", label: "All" },
  { value: "used", label: "In use" },
  { value: "waiting", label: "Waiting" },
  { value: "brought", label: "Brought" },
] as const;

export function DriversPage() {
  const drivers = useDrivers();
  const mayBring = useSession().data?.user?.lab_permissions.includes("submit") ?? false;
  const [filter, setFilter] = useState<Filter>("all");
  const [text, setText] = useState("");
  const [isBringing, setBringing] = useState(false);
  const [dropped, setDropped] = useState<File | null>(null);
  const drop = useDrop(mayBring, (file) => {
    setDropped(file);
    setBringing(true);
  });
  useTopics("drivers", "devices");
  const bring = (): void => {
    setDropped(null);
    setBringing(true);
  };
  return (
    <div className="wrap drivers" data-testid="drivers" data-over={drop.isOver} {...drop.handlers}>
      <div className="hd wrapping">
        <h1>{words.title}</h1>
        <i className="sp" />
        <Segments label="Show" value={filter} options={FILTERS} onChange={setFilter} />
        <Button
          look="pri"
          testId="bring-driver"
          why={mayBring ? null : words.mayNotBring}
          onClick={bring}
        >
          {words.bring}
        </Button>
      </div>
      {drop.isOver && <p className="dropnote">{words.drop}</p>}
      <input
        className="inp"
        type="search"
        aria-label={words.find}
        placeholder={words.find}
        value={text}
        onChange={(event) => setText(event.target.value)}
        data-testid="driver-find"
      />
      <Loaded source={drivers} what="drivers">
        {(rows) => {
          const groups = groupDrivers(rows);
          const shown = groups.filter((group) => isShown(group, filter, text));
          return (
            <Card title={words.title} note={String(shown.length)}>
              {shown.length ? (
                <Table groups={shown} />
              ) : (
                <Empty>{groups.length ? words.noneShown : words.none}</Empty>
              )}
            </Card>
          );
        }}
      </Loaded>
      <BringDriver isOpen={isBringing} onClose={() => setBringing(false)} dropped={dropped} />
    </div>
  );
}

/** A file may be dropped anywhere on the page. */
function useDrop(isAllowed: boolean, onFile: (file: File) => void) {
  const [isOver, setOver] = useState(false);
  const depth = useRef(0);
  const isFile = (event: DragEvent): boolean =>
    isAllowed && event.dataTransfer.types.includes("Files");
  const handlers = {
    onDragEnter: (event: DragEvent): void => {
      if (!isFile(event)) return;
      event.preventDefault();
      depth.current += 1;
      setOver(true);
    },
    onDragOver: (event: DragEvent): void => {
      if (isFile(event)) event.preventDefault();
    },
    onDragLeave: (event: DragEvent): void => {
      if (!isFile(event)) return;
      depth.current = Math.max(0, depth.current - 1);
      setOver(depth.current > 0);
    },
    onDrop: (event: DragEvent): void => {
      if (!isFile(event)) return;
      event.preventDefault();
      depth.current = 0;
      setOver(false);
      const file = event.dataTransfer.files[0];
      if (file) onFile(file);
    },
  };
  return { isOver, handlers };
}

function Table({ groups }: { groups: DriverGroup[] }) {
  return (
    <table className="runs driverrows">
      <thead>
        <tr>
          <th>Driver</th>
          <th className="wide">Quality</th>
          <th>Newest version</th>
          <th className="wide r">Versions</th>
          <th className="wide">Since</th>
          <th>Used by</th>
        </tr>
      </thead>
      <tbody>
        {groups.map(({ module, newest, versions, devices }) => (
          <tr key={module} data-testid="driver-row" data-state={newest.state}>
            <td>
              <Link className="b" to={`/drivers/${newest.id}`}>
                {newest.class_name}
              </Link>
              <span className="mono m t12 under">{module.replace(/^drivers\./, "")}</span>
            </td>
            <td className="wide s">{newest.quality || "–"}</td>
            <td>
              <span className="vers">
                <span className="mono">{formatDigest(newest.digest)}</span>
                {newest.state !== "approved" && <StateChip state={driverState(newest.state)} />}
              </span>
            </td>
            <td className="wide r num">{versions.length}</td>
            <td className="wide s">
              <At at={newest.proposed_at ?? newest.read_at} />
            </td>
            <td className="s">
              {devices.length ? (
                devices.map((device) => device.name).join(", ")
              ) : (
                <span className="m">–</span>
              )}
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
