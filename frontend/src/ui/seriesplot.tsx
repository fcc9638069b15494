/** One kept series over its axis: a line, or sticks for a mass spectrum. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { useEffect, useRef } from "react";
import { axisLabel, drawnColumns, isSticks, markTexts } from "@/model/files";
import { formatNumber } from "@/model/format";
import type { Drawn } from "@/model/wirefiles";
import { resolve } from "./plot";
import { useIsDark } from "./theme";
import { useLabTime } from "./time";

export function SeriesPlot({ drawn, height }: { drawn: Drawn; height: number }) {
  const box = useRef<HTMLDivElement>(null);
  const isDark = useIsDark();
  const time = useLabTime();
  useEffect(() => {
    const node = box.current;
    if (!node) return;
    const marks = drawn.is_time ? (at: number[]) => at.map((one) => time.minute(one)) : markTexts;
    const options = plotOptions(drawn, node.clientWidth, height, marks);
    const made = new uPlot(options, drawnColumns(drawn), node);
    const resize = new ResizeObserver(() => made.setSize({ width: node.clientWidth, height }));
    resize.observe(node);
    return () => {
      resize.disconnect();
      made.destroy();
    };
  }, [drawn, height, isDark, time]);
  const { x, y } = drawn;
  return (
    <div
      ref={box}
      className="plotbox seriesplot"
      style={{ minHeight: height }}
      role="img"
      aria-label={`${axisLabel(y)} over ${axisLabel(x)}, ${formatNumber(drawn.rows_count, 0)} points`}
    />
  );
}

function plotOptions(
  drawn: Drawn,
  width: number,
  height: number,
  marks: (at: number[]) => string[],
): uPlot.Options {
  const axis = {
    stroke: resolve("--ink-3"),
    font: "11px 'Inter Variable', Inter, sans-serif",
    labelFont: "12px 'Inter Variable', Inter, sans-serif",
    labelSize: 18,
    grid: { stroke: resolve("--line"), width: 1 },
    ticks: { show: false },
  };
  const line = resolve("--p1");
  const sticks = isSticks(drawn) ? uPlot.paths.bars?.({ size: [0.6, 1.5] }) : undefined;
  return {
    width,
    height,
    legend: { show: false },
    cursor: { y: false, points: { size: 6 }, drag: { x: true, y: false } },
    padding: [8, 16, 0, 0],
    // Chemists read shifts from the left down to zero.
    scales: { x: { time: false, dir: drawn.x.unit.toUpperCase() === "PPM" ? -1 : 1 } },
    axes: [
      { ...axis, size: 24, space: 64, label: axisLabel(drawn.x), values: (_, at) => marks(at) },
      { ...axis, size: 44, space: 28, label: axisLabel(drawn.y), values: (_, at) => markTexts(at) },
    ],
    series: [
      {},
      {
        stroke: line,
        width: sticks ? 1 : 1.5,
        ...(sticks ? { fill: line } : {}),
        points: { show: drawn.points.length < 40, size: 4 },
        spanGaps: false,
        paths: sticks ?? null,
      },
    ] as uPlot.Series[],
  };
}
