import { expect, test } from "vitest";
import { readMinutes, whyNotReserved } from "./reserving";

test.each([
  ["30", "", 30],
  ["240", "ignored", 240],
  ["other", "1.5", 90],
  ["other", " 24 ", 1440],
  ["other", "0.02", 1],
])("%s %s is %i minutes", (span, hours, minutes) => {
  expect(readMinutes(span, hours)).toBe(minutes);
});

test.each(["", "0", "0.00", "24.01", "25", "1,5", "-1", "1e1", "two", "1.555", "Infinity"])(
  "%s hours are refused",
  (hours) => {
    expect(readMinutes("other", hours)).toBeNull();
    expect(whyNotReserved(null, "a reflux")).toContain("24");
  },
);

test("the reason is asked for", () => {
  expect(whyNotReserved(30, "  ")).toContain("what it is for");
  expect(whyNotReserved(30, "a reflux")).toBeNull();
});
