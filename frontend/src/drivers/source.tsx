/** The text of a version, and what differs from another one. */

import { useState } from "react";
import { useDriverChanges } from "@/api/drivers";
import { linesOf, newestFirst, orderedModules } from "@/model/drivers";
import { formatDigest } from "@/model/format";
import type { ChangedLine, DriverDetail, DriverRow, ModuleChange } from "@/model/wiredrivers";
import { Card, Empty, Loaded } from "@/ui/card";
import { Segments } from "@/ui/controls";
import { useSeen } from "@/ui/seen";
import { words } from "./words";

interface Props {
  driver: DriverDetail;
  onSeen: () => void;
}

export function Source({ driver, onSeen }: Props) {
  const modules = orderedModules(driver.module, driver.sources);
  const [shown, setShown] = useState(driver.module);
  const text = driver.sources[shown] ?? "";
  const options = modules.map((name) => ({ value: name, label: name.split(".").at(-1) ?? name }));
  return (
    <Card
      title={words.source.title}
      note={shown}
      testId="driver-source"
      actions={
        options.length > 1 && (
          <Segments label="Module" value={shown} options={options} onChange={setShown} />
        )
      }
    >
      <div className="code" tabIndex={0} role="region" aria-label={shown} key={shown}>
        <table>
          <tbody>
            {linesOf(text).map((line, place) => (
              <tr key={place} id={`L${place + 1}`}>
                <td className="ln">{place + 1}</td>
                <td>{line}</td>
              </tr>
            ))}
          </tbody>
        </table>
        {shown === driver.module && <End onSeen={onSeen} />}
      </div>
    </Card>
  );
}

function End({ onSeen }: { onSeen: () => void }) {
  const end = useSeen(onSeen);
  return <div ref={end} className="endmark" />;
}

/** The comparison with another version; the one before is compared first. */
export function Changes({ driver, versions, onSeen }: Props & { versions: DriverRow[] }) {
  const others = newestFirst(versions).filter((row) => row.id !== driver.id);
  const before = previousOf(driver, versions);
  const [chosen, setChosen] = useState<string | null>(null);
  const since = chosen ?? before?.id ?? null;
  const changes = useDriverChanges(driver.id, since);
  return (
    <Card
      title={words.changes.title}
      testId="driver-changes"
      actions={
        others.length > 0 && (
          <label className="since">
            <span className="m">{words.changes.since}</span>
            <select
              className="inp"
              value={since ?? ""}
              data-testid="changes-since"
              onChange={(event) => setChosen(event.target.value || null)}
            >
              <option value="">–</option>
              {others.map((row) => (
                <option key={row.id} value={row.id}>
                  {versionText(row)}
                </option>
              ))}
            </select>
          </label>
        )
      }
    >
      {others.length === 0 && <Empty>{words.changes.first}</Empty>}
      {since !== null && (
        <Loaded source={changes} what="changes">
          {(modules) =>
            modules.length ? (
              <>
                {modules.map((module) => (
                  <Module key={module.module} change={module} />
                ))}
                {since === before?.id && <End onSeen={onSeen} />}
              </>
            ) : (
              <Empty>{words.changes.none}</Empty>
            )
          }
        </Loaded>
      )}
    </Card>
  );
}

/** The approved version that came before this one. */
function previousOf(driver: DriverDetail, versions: DriverRow[]): DriverRow | undefined {
  const sorted = newestFirst(versions);
  const place = sorted.findIndex((row) => row.id === driver.id);
  return sorted.slice(place + 1).find((row) => row.state === "approved");
}

export function versionText(row: DriverRow): string {
  const at = (row.proposed_at ?? row.read_at).slice(0, 10);
  const from = row.origin === "release" ? "release" : (row.proposed_by ?? "");
  return `${formatDigest(row.digest)} · ${at} · ${from}${row.state === "approved" ? "" : ` · ${row.state}`}`;
}

function Module({ change }: { change: ModuleChange }) {
  return (
    <section className="changed" aria-label={change.module}>
      <p className="changedhead">
        <span className="mono">{change.module}</span>
        {change.is_new && <span className="m">{words.changes.new}</span>}
        {change.is_gone && <span className="m">{words.changes.gone}</span>}
        <i className="sp" />
        <span className="num s">
          −{change.removed_count} +{change.added_count}
        </span>
      </p>
      <div className="code" tabIndex={0} role="region" aria-label={`Changes of ${change.module}`}>
        <table>
          {change.hunks.map((hunk, place) => (
            <tbody key={place}>
              {hunk.map((line) => (
                <DiffLine key={`${line.before} ${line.after}`} line={line} />
              ))}
            </tbody>
          ))}
        </table>
      </div>
    </section>
  );
}

function DiffLine({ line }: { line: ChangedLine }) {
  const word = { "": "", "-": "removed", "+": "added" }[line.sign];
  return (
    <tr data-sign={line.sign || undefined}>
      <td className="ln">{line.before}</td>
      <td className="ln">{line.after}</td>
      <td className="sign">
        {line.sign}
        {word && <span className="vh">{word}</span>}
      </td>
      <td>{line.sign === "-" ? <del>{line.text}</del> : line.text}</td>
    </tr>
  );
}
