import { expect, test } from "vitest";
import {
  EMPTY_REACTION,
  massBalance,
  newId,
  reactionOf,
  whyNotReacted,
  type ReactionDraft,
} from "./reaction";
import type { ReactionStock } from "./wirelab";

const stock: ReactionStock = {
  is_allowed: true,
  lots: [
    {
      lot_id: "acid",
      lot: "A-1",
      material: "Acid",
      unit: "nl",
      amount: 1_000_000,
      density_mg_ul: 1.2,
    },
    {
      lot_id: "base",
      lot: "B-1",
      material: "Base",
      unit: "ug",
      amount: 50_000,
      density_mg_ul: null,
    },
  ],
  materials: [{ id: "salt", name: "Salt", density_mg_ul: null }],
};
const draft: ReactionDraft = {
  ...EMPTY_REACTION,
  consumed: { acid: "40 µL", base: "48 mg" },
  materialId: "salt",
  amount: "90 mg",
  key: "salt-1",
  reason: "weighed",
};

test("the residue is what the masses leave over, and it is stated", () => {
  expect(massBalance(stock, draft)).toEqual({ consumed: 96_000, made: 90_000, residue: 6_000 });
  expect(reactionOf("jar", stock, draft, "new")).toEqual({
    op: "react",
    resource_id: "jar",
    reactants: [
      { lot_id: "acid", amount_nl: 40_000 },
      { lot_id: "base", amount_ug: 48_000 },
    ],
    products: [
      { lot_id: "new", material_id: "salt", key: "salt-1", phase: "solid", amount_ug: 90_000 },
    ],
    residue_ug: 6_000,
    reason: "weighed",
  });
});

test.each<[Partial<ReactionDraft>, RegExp]>([
  [{ consumed: {} }, /at least one lot/],
  [{ consumed: { base: "51 mg" } }, /less of Base/],
  [{ materialId: null }, /which material/],
  [{ amount: "" }, /how much/],
  [{ amount: "much" }, /how much/],
  [{ key: " " }, /name of its own/],
  [{ amount: "97 mg" }, /More mass was made/],
  [{ reason: "" }, /how it is known/],
  [{ phase: "liquid", amount: "50 µL" }, /density nobody stated/],
])("what is missing is said before anything is sent: %o", (change, why) => {
  const wrong = { ...draft, ...change };
  expect(whyNotReacted(stock, wrong)).toMatch(why);
  expect(reactionOf("jar", stock, wrong, "new")).toBeNull();
});

test("a liquid product of unknown density goes with its mass", () => {
  const liquid: ReactionDraft = {
    ...draft,
    phase: "liquid",
    amount: "50 µL",
    weighed: { product: "90 mg" },
  };
  const told = reactionOf("jar", stock, liquid, "new");
  expect(told?.["products"]).toEqual([
    {
      lot_id: "new",
      material_id: "salt",
      key: "salt-1",
      phase: "liquid",
      amount_nl: 50_000,
      mass_ug: 90_000,
    },
  ]);
});

test("a new id is one of version 4", () => {
  const id = newId(new Uint8Array(16).fill(255));
  expect(id).toBe("ffffffff-ffff-4fff-bfff-ffffffffffff");
});
