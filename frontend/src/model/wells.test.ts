import { expect, test } from "vitest";
import { aRow } from "./samples";
import { mappedIds, wellMap } from "./wells";

const plate = (addresses: string[]) => [
  aRow("plate", null, { kind: "plate", holds_liquid: false }),
  ...addresses.map((address) => aRow(`plate/${address}`, "plate", { kind: "well" })),
];

test("wells lie by letter and number, whatever their order, past Z and past 9", () => {
  const map = wellMap(plate(["B10", "A2", "AA1", "Z1", "A10"]), "plate");
  expect(map?.letters).toEqual(["A", "B", "Z", "AA"]);
  expect(map?.numbers).toEqual([1, 2, 10]);
  expect(map?.at.get("AA1")?.row.id).toBe("plate/AA1");
  expect(map?.at.has("B1")).toBe(false);
});

test("a bench, whose things have names and no addresses, has no map", () => {
  expect(
    wellMap([aRow("bench", null), aRow("A1", "bench"), aRow("pump", "bench")], "bench"),
  ).toBeNull();
  expect(wellMap(plate([]), "plate")).toBeNull();
});

test("materials are summed over the wells, the most plentiful first", () => {
  const rows = plate(["A1", "A2"]).map((row) =>
    row.id === "plate"
      ? row
      : {
          ...row,
          contents: [
            { lot_id: "1", lot: "1", material: "dye", amount_nl: 5, amount_ug: 0 },
            { lot_id: "2", lot: "2", material: "water", amount_nl: 7, amount_ug: 0 },
          ],
        },
  );
  expect(wellMap(rows, "plate")?.materials).toEqual([
    { name: "water", amount_nl: 14 },
    { name: "dye", amount_nl: 10 },
  ]);
});

test("a spot is taken when a tip stands in it", () => {
  const map = wellMap([...plate(["A1", "A2"]), aRow("tip", "plate/A2", { kind: "tip" })], "plate");
  expect([map?.at.get("A1")?.isTaken, map?.at.get("A2")?.isTaken]).toEqual([false, true]);
});

test("only what has enough places is folded away", () => {
  const rows = plate(["A1", "A2", "A3"]);
  expect(mappedIds(rows, 3)).toEqual(new Set(["plate"]));
  expect(mappedIds(rows, 4)).toEqual(new Set());
});
