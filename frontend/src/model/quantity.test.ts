import { expect, test } from "vitest";
import {
  findQuantityProblem,
  parseQuantity,
  showQuantity,
  storeQuantity,
  toCanonical,
} from "./quantity";
import { UNITS } from "./samples";

const volume = (text: string, fallback = "") => parseQuantity(text, "volume", UNITS, fallback);

test.each(["250 uL", "250uL", "250 µL", "250\u202fµL", "0.25 mL", "0.25ml"])(
  "%s is a quarter of a millilitre",
  (text) => {
    const parsed = volume(text);
    expect(parsed.ok && toCanonical(parsed.quantity, "volume")).toBe(250);
  },
);

test("micro is stored in one spelling however it was typed", () => {
  for (const text of ["250 uL", "250 µL", "250 ul"]) {
    const parsed = volume(text);
    expect(parsed.ok && storeQuantity(parsed.quantity, UNITS, "volume")).toBe("250 µL");
  }
});

test("a mass is refused in a field for volumes, with the units that fit", () => {
  const parsed = volume("5 g");
  expect(parsed.ok ? "" : parsed.reason).toBe("g is no unit of volume: use mL, µL, L.");
});

test("a decimal comma is refused with a hint and never guessed", () => {
  const parsed = volume("2,5 mL");
  expect(parsed.ok ? "" : parsed.reason).toBe("Write a decimal point, not a comma.");
});

test("a bare number takes the unit of its field, and is refused without one", () => {
  const parsed = volume("5", "mL");
  expect(parsed.ok && parsed.quantity).toEqual({ number: "5", unit: "mL" });
  expect(volume("5").ok).toBe(false);
});

test("a unit in words is the unit that it means, and is stored as that", () => {
  const parsed = parseQuantity("2 hours", "time", UNITS);
  expect(parsed.ok && toCanonical(parsed.quantity, "time")).toBe(7200);
  expect(parsed.ok && storeQuantity(parsed.quantity, UNITS, "time")).toBe("2 h");
  const unknown = parseQuantity("2 fortnights", "time", UNITS);
  expect(unknown.ok ? "" : unknown.reason).toBe(
    "fortnights is no unit of time: use min, s, h, ms.",
  );
});

test("kelvin become degrees Celsius", () => {
  const parsed = parseQuantity("333.15 K", "temperature", UNITS);
  expect(parsed.ok && toCanonical(parsed.quantity, "temperature")).toBeCloseTo(60, 6);
});

test("absolute zero is a limit for temperatures, zero for all else", () => {
  expect(findQuantityProblem({ number: "-78", unit: "°C" }, "temperature")).toBeNull();
  expect(findQuantityProblem({ number: "-300", unit: "°C" }, "temperature")).toMatch(
    /absolute zero/,
  );
  expect(findQuantityProblem({ number: "0", unit: "mL" }, "volume")).toMatch(/more than zero/);
});

test("a sentence shows a narrow space before the unit", () => {
  expect(showQuantity("5 mL")).toBe("5\u202fmL");
  expect(showQuantity("as typed")).toBe("as typed");
});
