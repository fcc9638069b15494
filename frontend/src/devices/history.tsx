/** What a device told over a chosen time, as curves and as files. */

import { useMemo, useState } from "react";
import { useCurves, useLiveSamples } from "@/api/telemetry";
import {
  bandColumns,
  drawable,
  gapWords,
  levelDrawn,
  RANGES,
  readableUnit,
  spanOf,
  stepWords,
  whyNoRange,
  withLive,
  type Curve,
  type Curves,
  type Gap,
  type RangeName,
} from "@/model/curves";
import { toSeconds } from "@/model/format";
import { labelOf } from "@/model/telemetry";
import type { Device } from "@/model/wire";
import { BandPlot } from "@/ui/bandplot";
import { AsOf, Card, Empty, Failed } from "@/ui/card";
import { Button, Segments } from "@/ui/controls";
import { Downloads, type Download } from "@/ui/downloads";
import { useLabTime, useNow } from "@/ui/time";
import { words } from "./words";

type Chosen = { name: RangeName; since_s: number; until_s: number };

export function History({ device }: { device: Device }) {
  const [chosen, setChosen] = useState<Chosen>({ name: "15min", since_s: 0, until_s: 0 });
  const span = spanOf(chosen.name);
  const isReady = span !== undefined || chosen.until_s > 0;
  const source = useCurves(isReady ? device.id : "", span ?? chosen);
  const live = useLiveSamples(device.id, span !== undefined);
  const curves = useMemo(
    () => drawable(withLive(source.data?.curves ?? [], live)),
    [source.data, live],
  );
  const pick = (name: RangeName): void => setChosen((old) => ({ ...old, name }));
  return (
    <Card
      title={words.history.title}
      testId="telemetry"
      actions={source.data && <Downloads files={filesOf(device, source.data)} />}
    >
      <div className="historybar">
        <Segments
          label={words.history.range}
          value={chosen.name}
          options={[...RANGES, { value: "custom" as const, label: words.history.custom }]}
          onChange={pick}
        />
        {chosen.name === "custom" && (
          <OwnRange
            onChoose={(since_s, until_s) => setChosen({ name: "custom", since_s, until_s })}
          />
        )}
      </div>
      {source.error && source.data && <AsOf at={source.dataUpdatedAt} why={source.error.message} />}
      {curves.length > 0 && source.data ? (
        <div className="plots wideplots">
          {curves.map(({ curve, set }) => (
            <StatusHistory
              key={curve.status}
              curve={curve}
              set={set}
              told={source.data}
              names={curves.map((one) => one.curve.status)}
              isLive={span !== undefined}
            />
          ))}
        </div>
      ) : source.error ? (
        <Failed what={words.history.what} error={source.error} retry={source.refetch} />
      ) : (
        <Empty>
          {!isReady ? words.history.choose : source.isPending ? "Loading…" : words.history.none}
        </Empty>
      )}
    </Card>
  );
}

function StatusHistory(props: {
  curve: Curve;
  set: Curve | null;
  told: Curves;
  names: string[];
  isLive: boolean;
}) {
  const { curve, set, told, isLive } = props;
  const [unit, factor] = readableUnit(curve);
  const columns = useMemo(
    () => bandColumns(curve, set, told.gaps, factor),
    [curve, set, told.gaps, factor],
  );
  const now = useNow(1000);
  const label = labelOf(curve.status, curve.label, props.names);
  const until_s = isLive ? Math.max(now, told.until_s) : told.until_s;
  return (
    <figure className="plot" data-testid={`plot-${curve.status}`}>
      <figcaption>
        <b className="b cut">{label}</b>
        <i className="sp" />
        <span className="m">{stepWords(curve)}</span>
        <GapNote gaps={told.gaps} />
      </figcaption>
      <BandPlot
        label={label}
        unit={unit}
        columns={columns}
        gaps={told.gaps}
        since_s={until_s - (told.until_s - told.since_s)}
        until_s={until_s}
        isStepped={
          curve.status.endsWith("_index") || (curve.is_share === true && curve.level_s === 0)
        }
        height={170}
        {...(curve.is_share && { bounds: [0, 100] })}
      />
    </figure>
  );
}

function GapNote({ gaps }: { gaps: readonly Gap[] }) {
  const text = gapWords(gaps);
  return text ? (
    <span className="m" data-testid="gaps">
      {text}
    </span>
  ) : null;
}

/** Two times on the clock of the lab. */
function OwnRange({ onChoose }: { onChoose: (since_s: number, until_s: number) => void }) {
  const time = useLabTime();
  const [opened] = useState(() => Date.now() / 1000);
  const [since, setSince] = useState(() => time.field(opened - 3600));
  const [until, setUntil] = useState(() => time.field(opened));
  const wrong = whyNoRange(time.instant(since), time.instant(until));
  const show = (): void => {
    const [from, to] = [toSeconds(time.instant(since)), toSeconds(time.instant(until))];
    if (from !== null && to !== null) onChoose(from, to);
  };
  return (
    <form
      className="ownrange"
      onSubmit={(event) => {
        event.preventDefault();
        if (!wrong) show();
      }}
    >
      <label className="t12">
        {words.history.from}
        <input
          type="datetime-local"
          step={1}
          value={since}
          onChange={(event) => setSince(event.target.value)}
        />
      </label>
      <label className="t12">
        {words.history.to}
        <input
          type="datetime-local"
          step={1}
          value={until}
          onChange={(event) => setUntil(event.target.value)}
        />
      </label>
      <Button type="submit" disabled={wrong !== null}>
        {words.history.show}
      </Button>
      {wrong && (
        <span className="help bad" role="alert">
          {wrong}
        </span>
      )}
    </form>
  );
}

/** The range that is shown, as files: each sample, or buckets as fine as the curves. */
function filesOf(device: Device, told: Curves): Download[] {
  const drawn = levelDrawn(told.curves);
  return (["raw", drawn] as const).flatMap((level) =>
    (["csv", "parquet"] as const).map((form) => ({
      label: `${level === "raw" ? words.history.samples : words.history.rolled(level)}, ${form === "csv" ? "CSV" : "Parquet"}`,
      about: level === "raw" ? words.history.aboutSamples : words.history.aboutRolled,
      path: `devices/${device.id}/telemetry/export?form=${form}&level=${level}&since_s=${told.since_s}&until_s=${told.until_s}`,
      name: `${device.key}-${level}.${form}`,
      testId: `export-${level}-${form}`,
    })),
  );
}
