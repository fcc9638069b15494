/** How long a reservation lasts, as a person says it. */

const LONGEST_H = 24;

export const SPANS = [
  { value: "30", label: "30 min" },
  { value: "60", label: "1 h" },
  { value: "240", label: "4 h" },
  { value: "other", label: "Other…" },
] as const satisfies readonly { value: string; label: string }[];

/** Whole minutes of a choice; null where what was written is no time that can be reserved. */
export function readMinutes(span: string, hours: string): number | null {
  if (span !== "other") return Number(span);
  if (!/^\d{1,2}(\.\d{1,2})?$/.test(hours.trim())) return null;
  const minutes = Math.round(Number(hours) * 60);
  return minutes > 0 && minutes <= LONGEST_H * 60 ? minutes : null;
}

export function whyNotReserved(minutes: number | null, reason: string): string | null {
  if (minutes === null) return `Write hours above 0 and up to ${LONGEST_H}, with a point: 1.5`;
  return reason.trim() ? null : "Write what it is for: the others read it.";
}
