/** The live stream: when a message is missing, and how long to wait before the next try. */

export type Verdict = "next" | "gap" | "old";

/** Counts per topic; numbering starts anew with each connection. */
export class SeqTracker {
  private readonly last = new Map<string, number>();

  /** Judge a message and remember it. */
  see(topic: string, seq: number): Verdict {
    const before = this.last.get(topic);
    if (before !== undefined && seq <= before) return "old";
    this.last.set(topic, seq);
    return before === undefined || seq === before + 1 ? "next" : "gap";
  }

  forget(topic: string): void {
    this.last.delete(topic);
  }

  reset(): void {
    this.last.clear();
  }
}

const FIRST_MS = 500;
const LONGEST_MS = 8000;

/** Wait before try number `attempt` (from 0): doubling from 0.5 s to 8 s, with jitter. */
export function backOff(attempt: number, random: number): number {
  const full = Math.min(LONGEST_MS, FIRST_MS * 2 ** Math.min(attempt, 10));
  return Math.round(full * (0.5 + random / 2));
}
