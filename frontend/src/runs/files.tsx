/** What a run has measured as files: whether each is here, its bytes, and a curve where it has one. */

import { useState } from "react";
import { Link } from "react-router";
import { contentPath, useFile, usePoints } from "@/api/files";
import { firstDrawn, formatBytes, formatLabel, missingText } from "@/model/files";
import { sentence } from "@/model/format";
import { fileState } from "@/model/states";
import type { Run } from "@/model/wire";
import type { RunFile } from "@/model/wirefiles";
import { Card } from "@/ui/card";
import { Curve } from "@/ui/curve";
import { Icon } from "@/ui/icons";
import { StateChip } from "@/ui/state";
import { words } from "./words";

/** The file to draw first: the newest that was read into readings. */
const firstShown = (files: readonly RunFile[]): RunFile | null =>
  files.findLast((file) => file.state === "parsed" && file.format !== "none") ?? null;

export function RunFiles({ run }: { run: Run }) {
  const [picked, setPicked] = useState<string | null>(null);
  if (run.files.length === 0) return null;
  const shown = run.files.find((file) => file.id === picked) ?? firstShown(run.files);
  const missing = missingText(run.files);
  return (
    <Card
      title={words.measured.title}
      note={missing ? <span className="tone-error">{missing}</span> : String(run.files.length)}
      testId="run-files"
    >
      <ul className="runfiles">
        {run.files.map((file) => (
          <FileLine
            key={file.id}
            run={run}
            file={file}
            isShown={file.id === shown?.id}
            onShow={() => setPicked(file.id)}
          />
        ))}
      </ul>
      {shown?.file_id && <Drawing key={shown.file_id} fileId={shown.file_id} />}
    </Card>
  );
}

function FileLine(props: { run: Run; file: RunFile; isShown: boolean; onShow: () => void }) {
  const { run, file, isShown, onShow } = props;
  const job = run.jobs.find((one) => one.id === file.job_id);
  const isDrawable = file.state === "parsed" && file.format !== "none";
  return (
    <li data-testid="run-file" data-state={file.state} aria-current={isShown || undefined}>
      <StateChip state={fileState(file.state)} />
      <span className="filetext">
        {file.file_id ? (
          <Link className="b" to={`/files/${file.file_id}`}>
            {file.name}
          </Link>
        ) : (
          <span className="b">{file.name}</span>
        )}{" "}
        <span className="m">
          {job && words.measured.by(job.index + 1)}, {formatBytes(file.size_bytes)}
          {file.format !== "none" && `, ${formatLabel(file.format)}`}
        </span>
        {file.message && <span className="why tone-error">{sentence(file.message)}</span>}
      </span>
      {isDrawable && !isShown && (
        <button type="button" className="link" onClick={onShow} data-testid="show-file">
          {words.measured.draw}
        </button>
      )}
      {file.file_id && (
        <a
          className="ib"
          href={contentPath(file.file_id)}
          download
          aria-label={`${words.measured.download} ${file.name}`}
          title={`${words.measured.download} ${file.name}`}
          data-testid="run-file-download"
        >
          <Icon name="download" />
        </a>
      )}
    </li>
  );
}

function Drawing({ fileId }: { fileId: string }) {
  const file = useFile(fileId);
  const drawn = file.data ? firstDrawn(file.data.readings) : null;
  return drawn ? <Series key={drawn.id} readingId={drawn.id} /> : null;
}

function Series({ readingId }: { readingId: string }) {
  const [scan, setScan] = useState<number | null>(null);
  return <Curve source={usePoints(readingId, scan)} height={220} onScan={setScan} />;
}
