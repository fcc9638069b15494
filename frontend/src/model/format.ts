/** Numbers, times and amounts as a person reads them. */

/** Narrow no-break space between number and unit. */
export const THIN = "\u202f";
const MINUS = "\u2212";

/** Write a number with fixed decimals, figures in groups of three, and a true minus sign. */
export function formatNumber(value: number, decimals?: number): string {
  if (!Number.isFinite(value)) return "–";
  const places = decimals ?? defaultDecimals(value);
  const text = Math.abs(value).toFixed(places);
  const [whole = "0", fraction] = text.split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+(?!\d))/g, THIN) : whole;
  const sign = value < 0 && Number(text) !== 0 ? MINUS : "";
  return sign + grouped + (fraction ? `.${fraction}` : "");
}

function defaultDecimals(value: number): number {
  if (Number.isInteger(value)) return 0;
  const size = Math.abs(value);
  if (size >= 100) return 1;
  return size >= 1 ? 2 : 3;
}

/** Volume in the unit a chemist would write: 5.00 mL, 250 µL. */
export function formatVolume(amountNl: number): string {
  const [value, unit] = splitVolume(amountNl);
  return `${value}${THIN}${unit}`;
}

/** Volume as number and unit apart. */
export function splitVolume(amountNl: number): [value: string, unit: string] {
  const size = Math.abs(amountNl);
  if (size !== 0 && size < 100_000)
    return [formatNumber(amountNl / 1000, size < 10_000 ? 2 : 1), "µL"];
  const ml = amountNl / 1_000_000;
  return [formatNumber(ml, size >= 100_000_000 ? 1 : 2), "mL"];
}

/** Mass in the unit a chemist would write: 12.50 mg, 1.200 g. */
export function splitMass(amountUg: number): [value: string, unit: string] {
  const size = Math.abs(amountUg);
  if (size < 1000) return [formatNumber(amountUg, 0), "µg"];
  if (size < 1_000_000) return [formatNumber(amountUg / 1000, 2), "mg"];
  return [formatNumber(amountUg / 1_000_000, 3), "g"];
}

/** Volume in millilitres alone, for a column that says so in its head. */
export function formatMl(amountNl: number): string {
  return formatNumber(amountNl / 1_000_000, 2);
}

/** Duration as clock figures: 0:05, 12:40, 1:02:30. */
export function formatDuration(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.max(0, Math.round(seconds));
  const h = Math.floor(whole / 3600);
  const m = Math.floor((whole % 3600) / 60);
  const s = String(whole % 60).padStart(2, "0");
  return h > 0 ? `${h}:${String(m).padStart(2, "0")}:${s}` : `${m}:${s}`;
}

/** Time that is left: in days where it is more than two. */
export function formatLeft(seconds: number): string {
  return seconds < 172_800 ? formatDuration(seconds) : `${Math.floor(seconds / 86_400)} days`;
}

/** Age of a value, short: 0.5 s, 12 s, 3 min, 2 h, 4 d. */
export function formatAge(seconds: number): string {
  const age = Math.max(0, seconds);
  if (age < 10) return `${age.toFixed(1)}${THIN}s`;
  if (age < 90) return `${Math.round(age)}${THIN}s`;
  if (age < 5400) return `${Math.round(age / 60)}${THIN}min`;
  if (age < 172_800) return `${Math.round(age / 3600)}${THIN}h`;
  return `${Math.round(age / 86_400)}${THIN}d`;
}

/** Reading of a device: figures for numbers, words for the rest. */
export function formatReading(value: number | string | boolean | null): string {
  if (value === null) return "–";
  if (typeof value === "number") return formatNumber(value);
  if (typeof value === "boolean") return value ? "yes" : "no";
  return value.replaceAll("_", " ");
}

const PLACES: Readonly<Record<string, number>> = { "°C": 1, rpm: 0, g: 3, mL: 2, pH: 2, kPa: 1 };

/** Number and unit as one reads them: 31.000 g, 3.05 mL, 22.0 °C, with decimals that never jump. */
export function splitReading(
  value: number | string | boolean | null,
  unit: string,
): [value: string, unit: string] {
  if (typeof value !== "number") return [formatReading(value), ""];
  if (unit === "µL") return splitVolume(value * 1000);
  if (unit === "mg" && Math.abs(value) >= 1000) return [formatNumber(value / 1000, PLACES.g), "g"];
  return [formatNumber(value, PLACES[unit]), unit];
}

/** Reading with its unit in one piece of text. */
export function readingText(value: number | string | boolean | null, unit: string): string {
  const [text, shown] = splitReading(value, unit);
  return shown ? `${text}${THIN}${shown}` : text;
}

/** Short form of a hash, in two groups of four. */
export function formatDigest(digest: string): string {
  return digest ? `${digest.slice(0, 4)} ${digest.slice(4, 8)}` : "–";
}

/** Clock and calendar in the zone of the lab, 24 hours, ISO order. */
export class LabTime {
  private readonly parts: Intl.DateTimeFormat;
  readonly zone: string;

  constructor(zone: string) {
    this.zone = zone;
    this.parts = new Intl.DateTimeFormat("en-GB", {
      timeZone: zone,
      year: "numeric",
      month: "2-digit",
      day: "2-digit",
      hour: "2-digit",
      minute: "2-digit",
      second: "2-digit",
      weekday: "short",
      hourCycle: "h23",
    });
  }

  private read(at: string | number): Record<string, string> {
    const when = typeof at === "number" ? new Date(at * 1000) : new Date(at);
    if (Number.isNaN(when.getTime())) return {};
    return Object.fromEntries(this.parts.formatToParts(when).map((p) => [p.type, p.value]));
  }

  /** 14:02 */
  minute(at: string | number): string {
    const p = this.read(at);
    return p.hour ? `${p.hour}:${p.minute}` : "–";
  }

  /** 14:02:07 */
  second(at: string | number): string {
    const p = this.read(at);
    return p.hour ? `${p.hour}:${p.minute}:${p.second}` : "–";
  }

  /** 2026-11-20T14:02:07, as a field for a time takes it. */
  field(at: string | number): string {
    return `${this.day(at)}T${this.second(at)}`;
  }

  /** Instant of a time as read off the clock of the lab, or null when there is none such. */
  instant(field: string): string | null {
    const wanted = Date.parse(`${field}Z`);
    if (Number.isNaN(wanted)) return null;
    // The zone's offset there: twice, for the first guess may lie beyond a change of the clock.
    let at = wanted;
    for (let round = 0; round < 2; round += 1)
      at += wanted - Date.parse(`${this.field(at / 1000)}Z`);
    return new Date(at).toISOString();
  }

  /** 2026-11-20 */
  day(at: string | number): string {
    const p = this.read(at);
    return p.year ? `${p.year}-${p.month}-${p.day}` : "–";
  }

  /** 2026-11-20 14:02 */
  full(at: string | number): string {
    return `${this.day(at)} ${this.minute(at)}`;
  }

  /** Fri 2026-11-20 14:02 */
  long(at: string | number): string {
    return `${this.read(at).weekday ?? ""} ${this.full(at)}`;
  }

  /** 14:02 today, 2026-11-18 on other days. */
  near(at: string | number, now: number): string {
    return this.day(at) === this.day(now) ? this.minute(at) : this.day(at);
  }
}

/** Seconds since 1970 of an ISO time, or null. */
export function toSeconds(at: string | null | undefined): number | null {
  if (!at) return null;
  const value = Date.parse(at);
  return Number.isNaN(value) ? null : value / 1000;
}

/** Bare arguments of an action as words: volume_ul 5000 → 5.00 mL. */
export function formatArguments(args: Record<string, unknown>): string {
  return Object.entries(args)
    .map(([name, value]) => formatArgument(name, value))
    .join(", ");
}

const SUFFIXES: [suffix: string, unit: string][] = [
  ["_ul_s", "µL/s"],
  ["_mm_s", "mm/s"],
  ["_ul", "µL"],
  ["_nl", "nL"],
  ["_c", "°C"],
  ["_rpm", "rpm"],
  ["_s", "s"],
  ["_mg", "mg"],
  ["_kpa", "kPa"],
  ["_mm", "mm"],
];

function formatArgument(name: string, value: unknown): string {
  const words = (text: string): string => text.replaceAll("_", " ").trim();
  if (typeof value === "boolean") return `${words(name.replace(/^is_/, ""))}: ${plain(value)}`;
  if (typeof value !== "number") return `${words(name)} ${plain(value)}`;
  if (name.endsWith("_index")) return `${words(name.slice(0, -6))} ${formatNumber(value)}`;
  for (const [suffix, unit] of SUFFIXES) {
    if (!name.endsWith(suffix)) continue;
    const noun = words(name.slice(0, -suffix.length));
    if (unit === "µL") return `${noun} ${formatVolume(value * 1000)}`;
    if (unit === "nL") return `${noun} ${formatVolume(value)}`;
    return `${noun} ${formatNumber(value)}${THIN}${unit}`;
  }
  return `${words(name)} ${formatNumber(value)}`;
}

const PHRASES: [pattern: RegExp, words: string][] = [
  [/^port_index (\d+)$/, "port $1"],
  [/^is_(\w+) True$/, "$1"],
  [/^is_(\w+) False$/, "not $1"],
  [/^is_(\w+) unknown$/, "unknown whether $1"],
  [/^port_index unknown$/, "unknown port"],
  [/^(\w+?)_setpoint_\w+ None$/, "no $1 set"],
  [/^(\w+?)_setpoint_\w+ unknown$/, "unknown $1"],
];

/** What changed as an event tells it: "port_index 3" is port 3, "is_initialized True" initialized. */
export function changeWords(text: string): string {
  return text
    .split(", ")
    .map((part) => {
      const phrase = PHRASES.find(([pattern]) => pattern.test(part));
      if (phrase) return part.replace(phrase[0], phrase[1]).replaceAll("_", " ");
      const found = /^(\w+) (-?[\d.]+)$/.exec(part);
      if (!found) return part.replaceAll("_", " ");
      return shortChange(found[1] ?? "", Number(found[2]));
    })
    .join(", ");
}

/** A bare number with the unit that its name says: "temperature_setpoint_c 40.0" is set 40.0 °C. */
function shortChange(name: string, value: number): string {
  const suffix = SUFFIXES.find(([ending]) => name.endsWith(ending));
  const noun = name.slice(0, name.length - (suffix?.[0].length ?? 0)).replaceAll("_", " ");
  const text = readingText(value, suffix?.[1] ?? "");
  if (!suffix) return `${noun} ${text}`;
  return noun.endsWith("setpoint") ? `set ${text}` : text;
}

/** The line of a device by what a person knows it by: the socket it is plugged to, or its place on the net. */
export function lineWords(text: string): string {
  return text
    .replace(/\bserial:(?:\/\/)?[^\s,;?]*\/([^\s,;?/]+)(?:\?[^\s,;]*)?/g, "serial line $1")
    .replace(/\btcp:(?:\/\/)?(\S+?:\d+)/g, "network line $1");
}

/** A message of the server as a sentence: begins with a capital unless its first word is a name. */
export function sentence(message: string): string {
  const text = lineWords(message);
  return /^[a-z][a-z']*([ ,:;]|\.(?!\w)|$)/.test(text)
    ? text.charAt(0).toUpperCase() + text.slice(1)
    : text;
}

/** A field of a resource as a person reads it: capacity_ul 100000 is Capacity, 100.0 mL. */
export function formatFact(name: string, value: unknown): [label: string, text: string] {
  const words = (text: string): string => {
    const plainWords = text.replaceAll("_", " ").trim();
    return plainWords.charAt(0).toUpperCase() + plainWords.slice(1);
  };
  if (typeof value === "number") {
    const suffix = SUFFIXES.find(([ending]) => name.endsWith(ending));
    if (suffix) return [words(name.slice(0, -suffix[0].length)), readingText(value, suffix[1])];
  }
  return [words(name), plain(value)];
}

/** Any JSON value as one line. */
export function plain(value: unknown): string {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return formatNumber(value);
  if (typeof value === "boolean") return value ? "yes" : "no";
  return typeof value === "string" ? value : JSON.stringify(value);
}
