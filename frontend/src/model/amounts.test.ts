import { expect, test } from "vitest";
import { amountsOf, amountsText } from "./amounts";

test("amounts are read by line, and a key may have a colon", () => {
  expect(amountsOf("acid-1: 40 uL\n\nlab:base : 48 mg")).toEqual({
    "acid-1": "40 uL",
    "lab:base": "48 mg",
  });
  expect(amountsOf(" \n")).toBeUndefined();
});

test("a line without an amount is kept, so that the server says what is missing", () => {
  expect(amountsOf("acid-1")).toEqual({ "acid-1": "" });
});

test("what was read is written the same", () => {
  const text = "acid-1: 40 uL\nbase-1: 48 mg";
  expect(amountsText(amountsOf(text))).toBe(text);
  expect(amountsText(undefined)).toBe("");
});
