/** Kept files: what they are called, how large they are, and their series as columns to draw. */

import { formatNumber } from "./format";
import type { Drawn, FileReading, FileState } from "./wirefiles";

export const FORMATS: readonly { value: string; label: string; endings: readonly string[] }[] = [
  { value: "csv", label: "CSV: columns with units", endings: ["csv", "tsv", "txt"] },
  { value: "jcamp", label: "JCAMP-DX: spectra", endings: ["jdx", "dx", "jcamp", "jcm"] },
  { value: "mzml", label: "mzML: mass spectra", endings: ["mzml"] },
  { value: "andi", label: "ANDI: chromatograms, mass spectra", endings: ["cdf", "nc"] },
  { value: "neware", label: "Neware: battery cycler", endings: ["nda", "ndax"] },
  { value: "xml", label: "XML: AnIML or Neware", endings: ["xml", "animl"] },
  { value: "none", label: "Keep it, read nothing", endings: [] },
];

export const LARGEST_BYTES = 256 * 2 ** 20;

export const formatLabel = (value: string): string =>
  FORMATS.find((format) => format.value === value)?.label.split(":")[0] ?? value;

/** The format that files with such a name usually have; the person sees and says it. */
export function usualFormat(name: string): string {
  const ending = name.toLowerCase().split(".").at(-1) ?? "";
  return FORMATS.find((format) => format.endings.includes(ending))?.value ?? "none";
}

export function formatBytes(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  const units = ["kB", "MB", "GB"];
  let value = bytes / 1000;
  let place = 0;
  while (value >= 999.95 && place < units.length - 1) {
    value /= 1000;
    place += 1;
  }
  return `${formatNumber(value, 1)} ${units[place] ?? ""}`;
}

/** Why a file cannot be sent; null: it can. */
export function whyNotSent(
  file: { name: string; size: number } | null,
  hasSubject: boolean,
): string | null {
  if (!file) return "Choose a file first.";
  if (file.size === 0) return "The file is empty.";
  if (file.size > LARGEST_BYTES) return `A file may have ${formatBytes(LARGEST_BYTES)}.`;
  return hasSubject ? null : "Say what was measured, or which device it came from.";
}

/** How many files of a run are not here, in words; null: none is missing. */
export function missingText(files: readonly { state: FileState }[]): string | null {
  const count = (state: FileState): number => files.filter((file) => file.state === state).length;
  const [lost, awaited] = [count("lost"), count("awaited")];
  const parts = [lost && `${lost} lost`, awaited && `${awaited} not here yet`].filter(Boolean);
  return parts.length ? parts.join(", ") : null;
}

/** The reading to draw first: the one with the most points. */
export function firstDrawn(readings: readonly FileReading[]): FileReading | null {
  const drawn = readings.filter((reading) => reading.series !== null);
  const count = (reading: FileReading): number => reading.series?.points_count ?? 0;
  return drawn.reduce<FileReading | null>(
    (best, reading) => (best === null || count(reading) > count(best) ? reading : best),
    null,
  );
}

/** Columns for a plot, along the axis; a gap is a null. */
export function drawnColumns(drawn: Drawn): [number[], (number | null)[]] {
  const points = [...drawn.points].sort((a, b) => a[0] - b[0]);
  return [points.map(([x]) => x), points.map(([, y]) => y)];
}

/** A mass spectrum is drawn as sticks, all else as a line. */
export const isSticks = (drawn: Drawn): boolean => drawn.scan !== null;

/** Name of an axis with its unit. */
export function axisLabel(axis: { column: string; unit: string }): string {
  const unit = axis.unit && axis.unit !== "1" ? ` (${axis.unit})` : "";
  return `${axis.column}${unit}`;
}

/** Marks of an axis, each with as many decimals as the step needs. */
export function markTexts(at: readonly number[]): string[] {
  const step = Math.abs((at[1] ?? 1) - (at[0] ?? 0)) || 1;
  const largest = Math.max(...at.map(Math.abs), 0);
  if (largest >= 1e6 || (largest > 0 && largest < 1e-3))
    return at.map((value) => (value === 0 ? "0" : value.toExponential(1).replace("e+", "e")));
  const decimals = Math.min(6, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return at.map((value) => formatNumber(value, decimals));
}
