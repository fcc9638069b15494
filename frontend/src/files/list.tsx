/** Kept files, newest first, and the way to bring one. */

import "./files.css";
import { useState } from "react";
import { Link, useSearchParams } from "react-router";
import { useFiles, useIncoming, type About } from "@/api/files";
import type { Listed } from "@/api/pages";
import { formatBytes, formatLabel } from "@/model/files";
import type { FileRow, IncomingFile } from "@/model/wirefiles";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button } from "@/ui/controls";
import { countOf, More } from "@/ui/more";
import { At } from "@/ui/time";
import { BringDialog } from "./bring";
import { words } from "./words";

export function FilesPage() {
  const [params, setParams] = useSearchParams();
  const about: About = {
    resource: params.get("resource"),
    device: params.get("device"),
    job: params.get("job"),
  };
  const files = useFiles(about);
  const incoming = useIncoming(about);
  const [isBringing, setBringing] = useState(false);
  const isNarrowed = Object.values(about).some(Boolean);
  const bring = (
    <Button look="pri" testId="bring-file" onClick={() => setBringing(true)}>
      {words.bring}
    </Button>
  );
  return (
    <div className="wrap" data-testid="files">
      <div className="hd wrapping">
        <h1>{words.title}</h1>
        {isNarrowed && (
          <Button onClick={() => setParams({}, { replace: true })} testId="all-files">
            {words.all}
          </Button>
        )}
        <i className="sp" />
        {bring}
      </div>
      {incoming.data && incoming.data.length > 0 && <Incoming list={incoming} />}
      <Card title={words.title} note={countOf(files)}>
        <Loaded source={files} what="files">
          {(rows) =>
            rows.length ? (
              <>
                <Table rows={rows} />
                <More list={files} what="files" />
              </>
            ) : (
              <Empty>{isNarrowed ? words.noneHere : words.none}</Empty>
            )
          }
        </Loaded>
      </Card>
      <BringDialog isOpen={isBringing} onClose={() => setBringing(false)} about={about} />
    </div>
  );
}

const MOST_REASONS = 5;

/** What has not become a file: it waits for its reader, or was refused. */
function Incoming({ list }: { list: Listed<IncomingFile> }) {
  const rows = list.data ?? [];
  return (
    <Card title={words.incoming.title} note={countOf(list)} testId="incoming">
      <table className="runs filerows incoming">
        <tbody>
          {rows.map((row) => (
            <tr key={row.id} data-testid="incoming-row">
              <td className="b">{row.name}</td>
              <td>
                {row.state === "pending" || row.state === "awaited" ? (
                  words.incoming[row.state]
                ) : (
                  <span className="bad reasons">
                    {row.state === "lost" ? words.incoming.lost : words.incoming.refused}{" "}
                    {row.findings.length === 0
                      ? row.message
                      : row.findings.slice(0, MOST_REASONS).map((finding) => (
                          <span key={`${finding.subject} ${finding.message}`}>
                            {finding.subject && `${finding.subject}: `}
                            {finding.message}
                          </span>
                        ))}
                    {row.findings.length > MOST_REASONS && (
                      <span className="m">
                        {words.incoming.more(row.findings.length - MOST_REASONS)}
                      </span>
                    )}
                    <span className="mono m">{row.code}</span>
                  </span>
                )}
              </td>
              <td className="wide s">
                <At at={row.brought_at} />
              </td>
              <td className="wide s">{row.brought_by}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <More list={list} what="files" />
    </Card>
  );
}

function Table({ rows }: { rows: FileRow[] }) {
  return (
    <table className="runs filerows">
      <thead>
        <tr>
          <th>File</th>
          <th>About</th>
          <th className="wide">Read as</th>
          <th className="r wide">Size</th>
          <th className="wide">Kept</th>
          <th className="wide">By</th>
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => (
          <tr key={row.id} data-testid="file-row">
            <td>
              <Link className="b" to={`/files/${row.id}`}>
                {row.name}
              </Link>
            </td>
            <td>
              <Subject row={row} />
            </td>
            <td className="wide s">{formatLabel(row.format)}</td>
            <td className="r num wide">{formatBytes(row.size_bytes)}</td>
            <td className="wide s">
              <At at={row.kept_at} />
            </td>
            <td className="wide s">{row.kept_by}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** The sample; without one the device. */
function Subject({ row }: { row: FileRow }) {
  if (row.resource)
    return (
      <Link className="link" to={`/lab?sel=${row.resource.id}`}>
        {row.resource.name}
      </Link>
    );
  if (row.device)
    return (
      <Link className="link" to={`/devices/${row.device.id}`}>
        {row.device.name}
      </Link>
    );
  return <span className="m">–</span>;
}
