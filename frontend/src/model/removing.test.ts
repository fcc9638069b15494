import { expect, test } from "vitest";
import { makeStep } from "./document";
import { reaches } from "./graph";
import { applyEdit, startHistory, undo, undoLabel } from "./history";
import { removedText, removeSteps } from "./removing";
import type { WorkflowDocument } from "./wire";

/** Steps by their letters; `a>b` is order, `a.vessel>b.vessel` hands a vessel on. */
function flow(steps: string, ...edges: string[]): WorkflowDocument {
  return {
    schema: "labweb.workflow/1",
    name: "Flow",
    steps: [...steps].map((id) => makeStep(id, "stir", {}, { x: 0, y: 0 })),
    edges: edges.map((text, place) => {
      const [[source = "", out], [target = "", into]] = text
        .split(">")
        .map((end) => end.split(".")) as [string[], string[]];
      return {
        id: `e${place + 1}`,
        source,
        source_port: out ?? "done",
        target,
        target_port: into ?? "start",
      };
    }),
  };
}

const after = (document: WorkflowDocument, ...ids: string[]): WorkflowDocument =>
  applyEdit(startHistory(document), removeSteps(ids), 0).document;

const edgesOf = ({ edges }: WorkflowDocument): string[] =>
  edges.map((e) => `${e.source}.${e.source_port}>${e.target}.${e.target_port}`).sort();

const ORDER = (source: string, target: string): string => `${source}.done>${target}.start`;

test("deleting a middle step keeps the order of the steps around it", () => {
  const chain = flow("abc", "a>b", "b>c");
  expect(edgesOf(after(chain, "b"))).toEqual([ORDER("a", "c")]);
  expect(removedText(chain, ["b"])).toBe(
    "Step 2 was deleted; step 1 now leads to the former step 3.",
  );
});

test("undo brings the step and its own connections back, and takes the new one away", () => {
  const chain = flow("abc", "a>b", "b>c");
  const history = applyEdit(startHistory(chain), removeSteps(["b"]), 0);
  expect(undoLabel(history)).toBe("delete step");
  expect(undo(history).document).toEqual(chain);
});

test("deleting several steps at once keeps the order across all of them", () => {
  const chain = flow("abcde", "a>b", "b>c", "c>d", "d>e");
  expect(edgesOf(after(chain, "b", "c"))).toEqual([ORDER("a", "d"), ORDER("d", "e")]);
  expect(edgesOf(after(chain, "d", "b"))).toEqual([ORDER("a", "c"), ORDER("c", "e")]);
  expect(edgesOf(after(chain, "a", "e"))).toEqual([ORDER("b", "c"), ORDER("c", "d")]);
  expect(removedText(chain, ["b", "c"])).toBe(
    "2 steps were deleted; step 1 now leads to the former step 4.",
  );
  expect(removedText(chain, ["e"])).toBe("Step 5 was deleted.");
});

test("every step before leads to every step after, and what is ordered already gets no second way", () => {
  const diamond = flow("abmcd", "a>m", "b>m", "m>c", "m>d", "c>d");
  expect(edgesOf(after(diamond, "m"))).toEqual([ORDER("a", "c"), ORDER("b", "c"), ORDER("c", "d")]);
});

test("a vessel that was handed on through a deleted step is still handed on", () => {
  const chain = flow("abc", "a.vessel>b.vessel", "b.vessel>c.vessel");
  expect(edgesOf(after(chain, "b"))).toEqual(["a.vessel>c.vessel"]);
});

test("a vessel that a deleted step named itself stays with the step that had it from there", () => {
  const chain = flow("abc", "a>b", "b.vessel>c.vessel");
  const named = chain.steps.map((s) =>
    s.id === "b" ? { ...s, params: { vessel: "@reactor" } } : s,
  );
  const { steps, edges } = after({ ...chain, steps: named }, "b");
  expect(steps[1]?.params).toEqual({ vessel: "@reactor" });
  expect(edges).toMatchObject([{ source: "a", target: "c", target_port: "start" }]);
  expect(removedText({ ...chain, steps: named }, ["b"])).toBe(
    "Step 2 was deleted; step 1 now leads to the former step 3 and the former step 3 keeps its vessel.",
  );
});

test("a new connection never takes the id of one that went", () => {
  const chain = flow("abc", "a>b", "b>c");
  expect(after(chain, "b").edges.map((edge) => edge.id)).toEqual(["e3"]);
});

test("a ring that was stored loses its steps without an end", () => {
  const ring = flow("abc", "a>b", "b>c", "c>a", "b>b");
  expect(edgesOf(after(ring, "b"))).toEqual([ORDER("a", "c"), ORDER("c", "a")]);
  expect(after(ring, "a", "b", "c").steps).toEqual([]);
});

test.each([1, 7, 42, 418, 2026])(
  "whatever is deleted from a random graph, the steps that stay keep their order (seed %i)",
  (seed) => {
    let state = seed;
    const roll = (sides: number): number => {
      state = (state * 1_103_515_245 + 12_345) % 2_147_483_648;
      return state % sides;
    };
    const ids = [..."abcdefghij"];
    for (let round = 0; round < 40; round += 1) {
      const edges = ids.flatMap((one, place) =>
        ids.slice(place + 1).flatMap((other) => (roll(4) === 0 ? [`${one}>${other}`] : [])),
      );
      const document = flow(ids.join(""), ...edges);
      const gone = ids.filter(() => roll(3) === 0);
      const left = after(document, ...gone);
      const stay = ids.filter((id) => !gone.includes(id));
      for (const one of stay) {
        for (const other of stay) {
          expect(reaches(left, one, other)).toBe(reaches(document, one, other));
        }
      }
    }
  },
);
