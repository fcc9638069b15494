/** Mean of a status with the band from its lowest to its highest, and the times that are lost. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { useEffect, useRef, useState, type KeyboardEvent } from "react";
import { roomy, type BandColumns, type Gap } from "@/model/curves";
import { formatNumber, type LabTime } from "@/model/format";
import { decimals, resolve, spacing } from "./plot";
import { useIsDark } from "./theme";
import { useLabTime } from "./time";

interface BandPlotProps {
  label: string;
  unit: string;
  columns: BandColumns;
  gaps: readonly Gap[];
  since_s: number;
  until_s: number;
  isStepped: boolean;
  /** What the axis shows; without it, as much as the values need. */
  bounds?: [number, number];
  height: number;
}

export function BandPlot(props: BandPlotProps) {
  const { columns, height, isStepped, label, unit } = props;
  const box = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const shown = useRef(props);
  shown.current = props;
  const [place, setPlace] = useState<number | null>(null);
  const isDark = useIsDark();
  const time = useLabTime();
  const axis = unit ? `${label} (${unit})` : label;
  useEffect(() => {
    const node = box.current;
    if (!node) return;
    const made = new uPlot(
      plotOptions(node.clientWidth, height, unit, time, shown, setPlace, isStepped),
      [[], [], [], [], []],
      node,
    );
    plot.current = made;
    const resize = new ResizeObserver(() => made.setSize({ width: node.clientWidth, height }));
    resize.observe(node);
    return () => {
      resize.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [height, isDark, time, isStepped, unit]);
  useEffect(() => {
    plot.current?.setData(columns);
  }, [columns, props.since_s, props.until_s, isDark, time, height, isStepped, unit]);
  const move = (event: KeyboardEvent): void => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !plot.current) return;
    event.preventDefault();
    const next = nextPlace(columns, place, step);
    const at = columns[0][next];
    if (at === undefined) return;
    plot.current.setCursor({ left: plot.current.valToPos(at, "x"), top: 0 });
    setPlace(next);
  };
  return (
    <>
      <div
        ref={box}
        className="plotbox"
        style={{ height }}
        role="img"
        tabIndex={0}
        onKeyDown={move}
        aria-label={`${axis} over time, ${columns[0].length} points; arrow keys read them`}
      />
      <p className="t12 m readout num" aria-live="polite">
        {readout(columns, place, unit, time)}
      </p>
    </>
  );
}

/** The next point that has a value; the last one to begin with. */
function nextPlace(columns: BandColumns, place: number | null, step: number): number {
  const last = columns[0].length - 1;
  let next = place === null ? last : Math.min(last, Math.max(0, place + step));
  while (columns[1][next] === null && next > 0 && next < last) next += step;
  return next;
}

/** What the point under the cursor tells; without one, a space keeps the line. */
function readout(columns: BandColumns, place: number | null, unit: string, time: LabTime): string {
  const at = place === null ? undefined : columns[0][place];
  if (place === null || at === undefined) return "\u00a0";
  const [mean, low, high] = [columns[1][place], columns[2][place], columns[3][place]];
  const when = `${time.day(at)} ${time.second(at)}`;
  if (!isTold(mean) || !isTold(low) || !isTold(high)) return `${when}: gap`;
  const band = low === high ? "" : `, ${formatNumber(low)} to ${formatNumber(high)}`;
  return `${when}: ${formatNumber(mean)}${band} ${unit}`.trim();
}

/** Marks of the time axis: seconds, minutes or days, by how far they are apart. */
function marks(at: number[], time: LabTime): string[] {
  const step = spacing(at);
  if (step < 60) return at.map((one) => time.second(one));
  return at.map((one) => (step < 86400 ? time.minute(one) : time.day(one).slice(5)));
}

function plotOptions(
  width: number,
  height: number,
  unit: string,
  time: LabTime,
  shown: { current: BandPlotProps },
  setPlace: (place: number | null) => void,
  isStepped: boolean,
): uPlot.Options {
  const line = resolve("--p1");
  const lost = resolve("--ink-3");
  const font = "11px 'Inter Variable', Inter, sans-serif";
  const axis = { stroke: resolve("--ink-3"), font, labelFont: font, ticks: { show: false } };
  const stepped = uPlot.paths.stepped?.({ align: 1 }) ?? null;
  const edge = { stroke: "transparent", points: { show: false }, spanGaps: false };
  return {
    width,
    height,
    legend: { show: false },
    cursor: { y: false, points: { size: 6 }, drag: { x: false, y: false } },
    padding: [6, 16, 0, 0],
    scales: {
      x: { time: true, range: () => [shown.current.since_s, shown.current.until_s] },
      y: { range: (_, min, max) => shown.current.bounds ?? roomy(min, max) },
    },
    axes: [
      { ...axis, size: 22, space: 72, grid: { show: false }, values: (_, at) => marks(at, time) },
      {
        ...axis,
        size: 44,
        space: 28,
        gap: 4,
        ...(unit && { label: unit, labelSize: 16 }),
        grid: { stroke: resolve("--line"), width: 1 },
        values: (_, at) => at.map((v) => formatNumber(v, decimals(at))),
      },
    ],
    series: [
      {},
      {
        stroke: line,
        width: 1.75,
        points: { show: false },
        spanGaps: false,
        paths: isStepped ? stepped : null,
      },
      edge,
      edge,
      {
        stroke: line,
        width: 1.25,
        dash: [5, 4],
        alpha: 0.8,
        points: { show: false },
        paths: stepped,
      },
    ] as uPlot.Series[],
    bands: [{ series: [3, 2], fill: faded(line, 0.18) }],
    hooks: {
      drawClear: [(made) => shade(made, shown.current.gaps, faded(lost, 0.22))],
      setCursor: [(made) => setPlace(made.cursor.idx ?? null)],
    },
  };
}

/** Shade the times that are recorded as lost; a short one is still a line to see. */
function shade(made: uPlot, gaps: readonly Gap[], fill: string): void {
  const { ctx, bbox } = made;
  ctx.save();
  ctx.fillStyle = fill;
  for (const gap of gaps) {
    const from = Math.max(bbox.left, made.valToPos(gap.since, "x", true));
    const to = Math.min(bbox.left + bbox.width, made.valToPos(gap.until, "x", true));
    if (to >= bbox.left && from <= bbox.left + bbox.width)
      ctx.fillRect(from, bbox.top, Math.max(2, to - from), bbox.height);
  }
  ctx.restore();
}

/** A colour as the browser tells it, let through. */
const faded = (color: string, alpha: number): string =>
  `color-mix(in srgb, ${color} ${alpha * 100}%, transparent)`;

const isTold = (value: number | null | undefined): value is number => typeof value === "number";
