/** One curve with its setpoint, on a canvas that reads the tokens of the theme. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { useEffect, useRef } from "react";
import { roomy } from "@/model/curves";
import { formatNumber } from "@/model/format";
import { plotColumns, type Channel } from "@/model/telemetry";
import { useIsDark } from "./theme";
import { useLabTime } from "./time";

/** Colours as the browser computes them: a token may be light-dark(…). */
export function resolve(token: string): string {
  const probe = document.createElement("i");
  probe.style.color = `var(${token})`;
  document.body.append(probe);
  const { color } = getComputedStyle(probe);
  probe.remove();
  return color;
}

interface PlotProps {
  channel: Channel;
  height: number;
  from_s?: number;
  to_s?: number;
}

export function Plot({ channel, height, from_s, to_s }: PlotProps) {
  const box = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const isDark = useIsDark();
  const time = useLabTime();
  const isStepped = channel.status.endsWith("_index");
  const window_s = useRef<[number | undefined, number | undefined]>([from_s, to_s]);
  window_s.current = [from_s, to_s];
  useEffect(() => {
    const node = box.current;
    if (!node) return;
    const options = plotOptions(
      node.clientWidth,
      height,
      (at) => at.map((one) => (spacing(at) < 60 ? time.second(one) : time.minute(one))),
      window_s,
      isStepped,
    );
    const made = new uPlot(options, [[], [], []], node);
    plot.current = made;
    const resize = new ResizeObserver(() => made.setSize({ width: node.clientWidth, height }));
    resize.observe(node);
    return () => {
      resize.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [height, isDark, time, isStepped]);
  useEffect(() => {
    plot.current?.setData(plotColumns(channel));
  }, [channel, from_s, to_s, isDark, time, height]);
  return (
    <div
      ref={box}
      className="plotbox"
      style={{ height }}
      role="img"
      aria-label={`${channel.label}, ${channel.points.length} readings`}
    />
  );
}

function plotOptions(
  width: number,
  height: number,
  clock: (at: number[]) => string[],
  window_s: { current: [number | undefined, number | undefined] },
  isStepped: boolean,
): uPlot.Options {
  const line = resolve("--p1");
  const grid = { stroke: resolve("--line"), width: 1 };
  const axis = {
    stroke: resolve("--ink-3"),
    font: "11px 'Inter Variable', Inter, sans-serif",
    grid,
    ticks: { show: false },
  };
  return {
    width,
    height,
    legend: { show: false },
    cursor: { y: false, points: { size: 6 } },
    padding: [6, 20, 0, 0],
    scales: {
      x: {
        time: true,
        range: (_, min, max) => [window_s.current[0] ?? min, window_s.current[1] ?? max],
      },
      y: { range: (_, min, max) => roomy(min, max) },
    },
    axes: [
      { ...axis, size: 22, space: 64, values: (_, at) => clock(at), grid: { show: false } },
      {
        ...axis,
        size: 38,
        space: 28,
        gap: 4,
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
        paths: (isStepped ? uPlot.paths.stepped?.({ align: 1 }) : undefined) ?? null,
      },
      {
        stroke: line,
        width: 1.25,
        dash: [5, 4],
        alpha: 0.8,
        points: { show: false },
        spanGaps: false,
        paths: uPlot.paths.stepped?.({ align: 1 }) ?? null,
      },
    ] as uPlot.Series[],
  };
}

/** Distance between two marks of an axis. */
export const spacing = (at: number[]): number => Math.abs((at[1] ?? 1) - (at[0] ?? 0));

export function decimals(at: number[]): number {
  const step = spacing(at);
  return step >= 1 ? 0 : step >= 0.1 ? 1 : 2;
}
