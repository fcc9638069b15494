/** One kept file: what it is about, what was read from it, its series as a curve. */

import "./files.css";
import { useState } from "react";
import { Link, useParams } from "react-router";
import { contentPath, useFile, usePoints } from "@/api/files";
import { axisLabel, firstDrawn, formatBytes, formatLabel } from "@/model/files";
import { formatDigest, formatFact, formatNumber } from "@/model/format";
import type { FileDetail, FileReading } from "@/model/wirefiles";
import { Card, Empty } from "@/ui/card";
import { Curve } from "@/ui/curve";
import { Icon } from "@/ui/icons";
import { ReadingValue } from "@/ui/number";
import { At } from "@/ui/time";
import { PageState } from "@/ui/pagestate";
import { words } from "./words";

export function FilePage() {
  const { id = "" } = useParams();
  const file = useFile(id);
  if (!file.data) {
    return <PageState of="file" error={file.error} retry={file.refetch} />;
  }
  return <Details key={file.data.id} file={file.data} />;
}

function Details({ file }: { file: FileDetail }) {
  const [picked, setPicked] = useState(() => firstDrawn(file.readings)?.id ?? null);
  const shown = file.readings.find((reading) => reading.id === picked) ?? null;
  return (
    <div className="wrap devpage" data-testid="file">
      <div className="hd wrapping">
        <Link className="crumb" to="/files">
          {words.title}
        </Link>
        <span className="m">/</span>
        <h1 className="filename">{file.name}</h1>
        <i className="sp" />
        <a className="btn" href={contentPath(file.id)} download data-testid="download">
          <Icon name="download" />
          {words.detail.download}
        </a>
      </div>
      <div className="col">
        {shown?.series && (
          <Card
            title={shown.name}
            note={`${formatNumber(shown.series.points_count, 0)} points`}
            testId="curve"
          >
            <Drawing key={shown.id} reading={shown} />
          </Card>
        )}
        <Card title={words.detail.readings} note={String(file.readings_count)}>
          {file.readings.length ? (
            <Readings file={file} picked={picked} onPick={setPicked} />
          ) : (
            <Empty>{words.detail.noReadings}</Empty>
          )}
        </Card>
      </div>
      <aside className="col">
        <AboutCard file={file} />
        <Tells facts={file.facts} />
      </aside>
    </div>
  );
}

function Drawing({ reading }: { reading: FileReading }) {
  const [scan, setScan] = useState<number | null>(null);
  return <Curve source={usePoints(reading.id, scan)} height={280} onScan={setScan} />;
}

function Readings(props: {
  file: FileDetail;
  picked: string | null;
  onPick: (id: string) => void;
}) {
  const { file } = props;
  return (
    <>
      <table className="filereadings">
        <thead>
          <tr>
            <th>Reading</th>
            <th className="r">Value</th>
            <th className="wide">Measured</th>
          </tr>
        </thead>
        <tbody>
          {file.readings.map((reading) => (
            <tr
              key={reading.id}
              data-testid="file-reading"
              aria-selected={reading.id === props.picked ? true : undefined}
            >
              <td>
                <span className="b">{reading.name}</span>{" "}
                {reading.quantity !== reading.name && <span className="m">{reading.quantity}</span>}
              </td>
              <td className="r">
                <Value reading={reading} onDraw={() => props.onPick(reading.id)} />
              </td>
              <td className="wide s">
                {reading.measured_at ? (
                  <At at={reading.measured_at} />
                ) : (
                  <span className="m">–</span>
                )}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {file.readings_count > file.readings.length && (
        <p className="help note">
          {words.detail.more} {file.readings_count - file.readings.length}
        </p>
      )}
    </>
  );
}

function Value({ reading, onDraw }: { reading: FileReading; onDraw: () => void }) {
  if (!reading.series)
    return <ReadingValue value={reading.value ?? reading.text} unit={reading.unit} />;
  const { axes } = reading.series;
  const over = axes.map(axisLabel).join(", ");
  return (
    <button type="button" className="link" onClick={onDraw} data-testid="draw">
      {formatNumber(reading.series.points_count, 0)} points over {over}
    </button>
  );
}

function AboutCard({ file }: { file: FileDetail }) {
  return (
    <Card title={words.detail.about}>
      <dl className="kv inset">
        <Links file={file} />
        <dt>Read as</dt>
        <dd>{formatLabel(file.format)}</dd>
        <dt>Size</dt>
        <dd>{formatBytes(file.size_bytes)}</dd>
        <dt>SHA-256</dt>
        <dd className="mono" title={file.sha256}>
          {formatDigest(file.sha256)}
        </dd>
        <dt>Kept</dt>
        <dd>
          <At at={file.kept_at} /> by {file.kept_by || "–"}
        </dd>
        {file.series.map((made) => (
          <SeriesRow key={made.id} id={made.id} name={made.name} />
        ))}
      </dl>
    </Card>
  );
}

/** Sample, device and run, as far as the reader may know of them. */
function Links({ file }: { file: FileDetail }) {
  return (
    <>
      {file.resource && (
        <>
          <dt>Sample</dt>
          <dd>
            <Link className="link" to={`/lab?sel=${file.resource.id}`} data-testid="to-sample">
              {file.resource.name}
            </Link>
          </dd>
          <dt>Lineage</dt>
          <dd>
            <Link className="link" to={`/lineage/${file.resource.id}`}>
              What led to it
            </Link>
          </dd>
        </>
      )}
      {file.device && (
        <>
          <dt>Device</dt>
          <dd>
            <Link className="link" to={`/devices/${file.device.id}`}>
              {file.device.name}
            </Link>
          </dd>
        </>
      )}
      {file.job && (
        <>
          <dt>Run</dt>
          <dd>
            <Link
              className="link"
              to={`/runs/${file.job.run.id}?job=${file.job.id}`}
              data-testid="to-run"
            >
              #{file.job.run.number}: {file.job.sentence}
            </Link>
          </dd>
        </>
      )}
    </>
  );
}

function SeriesRow({ id, name }: { id: string; name: string }) {
  return (
    <>
      <dt>{words.detail.series}</dt>
      <dd>
        <a className="link" href={contentPath(id)} download>
          {name}
        </a>
      </dd>
    </>
  );
}

function Tells({ facts }: { facts: Record<string, unknown> }) {
  const rows = Object.entries(facts);
  if (!rows.length) return null;
  return (
    <Card title={words.detail.tells}>
      <dl className="kv inset">
        {rows.slice(0, 60).map(([name, value]) => {
          const [, text] = formatFact(name, value);
          return (
            <div key={name} className="fact">
              <dt>{name}</dt>
              <dd>{text}</dd>
            </div>
          );
        })}
      </dl>
    </Card>
  );
}
