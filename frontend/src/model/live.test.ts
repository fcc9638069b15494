import { expect, test } from "vitest";
import { backOff, SeqTracker } from "./live";

test("a missing number is a gap, on its own topic only", () => {
  const seqs = new SeqTracker();
  expect(seqs.see("runs", 1)).toBe("next");
  expect(seqs.see("runs", 2)).toBe("next");
  expect(seqs.see("lab", 1)).toBe("next");
  expect(seqs.see("runs", 4)).toBe("gap");
  expect(seqs.see("runs", 5)).toBe("next");
});

test("a repeated or older number is thrown away", () => {
  const seqs = new SeqTracker();
  seqs.see("runs", 5);
  expect(seqs.see("runs", 5)).toBe("old");
  expect(seqs.see("runs", 3)).toBe("old");
});

test("a new connection counts anew", () => {
  const seqs = new SeqTracker();
  seqs.see("runs", 9);
  seqs.reset();
  expect(seqs.see("runs", 1)).toBe("next");
});

test("the wait doubles from half a second to eight, with jitter below it", () => {
  expect([0, 1, 2, 3, 4, 9].map((attempt) => backOff(attempt, 1))).toEqual([
    500, 1000, 2000, 4000, 8000, 8000,
  ]);
  expect(backOff(4, 0)).toBe(4000);
  expect(backOff(1000, 1)).toBe(8000);
});
