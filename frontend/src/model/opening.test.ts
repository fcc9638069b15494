import { expect, test } from "vitest";
import { parseClip } from "./document";
import { openDocument, UnreadableDocument } from "./opening";

const STEP = { id: "a", kind: "wait" };
const EDGE = { id: "e", source: "a", source_port: "done", target: "b", target_port: "start" };

test("what a document may leave out is filled in", () => {
  const { document, notes } = openDocument({ steps: [STEP, { ...STEP, id: "b" }], edges: [EDGE] });
  expect(document.name).toBe("");
  expect(document.steps.map((step) => step.params)).toEqual([{}, {}]);
  const [a, b] = document.steps;
  expect(b?.position.x).toBeGreaterThan((a?.position.x ?? 0) + 212);
  expect(notes).toEqual([]);
  expect(openDocument({ steps: [] }).document.edges).toEqual([]);
});

test("a step without a place on the canvas stands below the others, and this is told", () => {
  const far = { ...STEP, id: "b", position: { x: 1e300, y: 0 } };
  const { document, notes } = openDocument({
    steps: [{ ...STEP, position: { x: 5, y: 50 } }, far],
  });
  expect(document.steps[0]?.position).toEqual({ x: 5, y: 50 });
  expect(document.steps[1]?.position.y).toBeGreaterThan(150);
  expect(notes).toHaveLength(1);
});

test("connections that lead nowhere or are there twice are left out, and this is told", () => {
  const steps = [STEP, { ...STEP, id: "b" }];
  const { document, notes } = openDocument({
    steps,
    edges: [EDGE, EDGE, { ...EDGE, id: "x", target: "gone" }],
  });
  expect(document.edges).toEqual([EDGE]);
  expect(notes).toHaveLength(2);
});

test.each([
  [null, "document"],
  [[], "document"],
  [{}, "steps"],
  [{ steps: {} }, "steps"],
  [{ steps: [], name: 5 }, "name"],
  [{ steps: [], edges: null }, "edges"],
  [{ steps: [null] }, "steps[0]"],
  [{ steps: [{ ...STEP, id: 1 }] }, "steps[0].id"],
  [{ steps: [STEP, STEP] }, "steps[1].id"],
  [{ steps: [{ id: "a" }] }, "steps[0].kind"],
  [{ steps: [{ ...STEP, params: null }] }, "steps[0].params"],
  [{ steps: [{ ...STEP, note: {} }] }, "steps[0].note"],
  [{ steps: [], edges: [{ id: "e" }] }, "edges[0].source"],
])("what cannot be shown is refused with its path: %j", (value, at) => {
  expect(() => openDocument(value)).toThrow(UnreadableDocument);
  expect(() => openDocument(value)).toThrow(`${at} is`);
});

test("pasted text that holds anything but steps is no clip", () => {
  const step = { ...STEP, params: {}, position: { x: 0, y: 0 } };
  expect(parseClip(JSON.stringify({ steps: [step], edges: [] }))).not.toBeNull();
  for (const broken of [
    { ...step, params: null },
    { ...step, kind: "加热" },
    { ...step, position: { x: null, y: 0 } },
    null,
  ]) {
    expect(parseClip(JSON.stringify({ steps: [broken], edges: [] }))).toBeNull();
  }
  expect(parseClip(JSON.stringify({ steps: [step], edges: [null] }))).toBeNull();
});
