/** Amounts by the key of a lot, as a person types them: `acid-1: 40 uL`, one on each line. */

export function amountsOf(text: string): Record<string, string> | undefined {
  const lines = text.split("\n").filter((line) => line.trim());
  const found = lines.map((line): [string, string] => {
    const at = line.lastIndexOf(":");
    return at < 0 ? [line.trim(), ""] : [line.slice(0, at).trim(), line.slice(at + 1).trim()];
  });
  return found.length ? Object.fromEntries(found) : undefined;
}

export function amountsText(value: unknown): string {
  if (typeof value !== "object" || value === null) return "";
  return Object.entries(value)
    .map(([lot, amount]) => `${lot}: ${String(amount)}`)
    .join("\n");
}
