import { expect, test } from "vitest";
import { placesFor, stepOf, whereText } from "./custody";
import { aRow } from "./samples";
import type { Custody } from "./wire";

const move: NonNullable<Custody["move"]> = {
  id: "m",
  state: "leaving",
  from: { id: "a", name: "Host 1" },
  to: { id: "b", name: "Host 2" },
  place: { id: "p", name: "Bench 9" },
  asked_by: "Ada",
  asked_at: "2026-11-20T06:02:07Z",
  released_at: null,
  is_told: false,
};

test("a move is asked, released, told, in this order", () => {
  expect(stepOf(move)).toBe("asked");
  expect(stepOf({ ...move, state: "in_transit" })).toBe("released");
  expect(stepOf({ ...move, state: "in_transit", is_told: true })).toBe("told");
});

test("each step says whose it is and what is to be done", () => {
  expect(whereText(move)).toMatch(/in the hands of Host 1 until/);
  expect(whereText({ ...move, state: "in_transit" })).toMatch(/nobody’s. Carry it to Bench 9/);
  expect(whereText({ ...move, state: "in_transit", is_told: true })).toMatch(/Host 2 was told/);
  expect(whereText({ ...move, from: null, place: null })).toMatch(/its host.*its place/);
});

test("a vessel goes to places, and neither into itself nor to where it stands", () => {
  const bench = aRow("bench", "lab", { kind: "bench" });
  const rows = [
    aRow("lab", null, { kind: "lab" }),
    bench,
    aRow("shelf", "lab", { kind: "bench" }),
    aRow("balance", "lab", { kind: "balance" }),
    aRow("free", "lab", { kind: "bench" }),
    aRow("rack", "bench", { kind: "bench" }),
    aRow("tube", "rack", { kind: "bench" }),
    aRow("flask", "bench", { kind: "flask" }),
  ];
  const rack = { id: "rack", parent_id: "bench" };
  const places = ["bench", "balance", "shelf", "free", "rack", "tube"].map((id) => ({
    id,
    why_not: id === "balance" ? "Vial 7 stands there" : null,
  }));
  expect(placesFor(rack, rows, places).map(({ row, whyNot }) => [row.id, whyNot])).toEqual([
    ["shelf", null],
    ["free", null],
    ["balance", "Vial 7 stands there"],
  ]);
});
