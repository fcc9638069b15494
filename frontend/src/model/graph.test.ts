import { expect, test } from "vitest";
import { makePalette } from "./document";
import { checkGraph, findTargets, orderSteps, whyNotConnect } from "./graph";
import { aDocument, OPERATIONS } from "./samples";

const palette = makePalette(OPERATIONS);
const why = (from: string, into: string): string | null => {
  const [step = "", port = ""] = from.split(".");
  const [target = "", entry = ""] = into.split(".");
  return whyNotConnect(palette, aDocument(), { step, port }, { step: target, port: entry });
};

test("equal sorts connect", () => {
  expect(why("b.done", "c.start")).toBeNull();
  expect(why("a.target", "b.target")).toBeNull();
});

test("a value cannot go where an order is wanted, and the reason says both", () => {
  expect(why("c.value", "a.start")).toBe("This gives a value (◆), that wants an order (▸).");
});

test("a circle, a second wire and a wire to itself are refused", () => {
  expect(why("b.done", "a.start")).toBe("This would make a circle.");
  expect(why("a.done", "b.start")).toBe("They are wired already.");
  expect(why("a.done", "a.start")).toBe("A step cannot be wired to itself.");
});

test("a material wire between two different vessels is refused", () => {
  expect(why("a.source", "b.source")).toBe("The two steps name different vessels.");
});

test("steps come after all they wait for, ties as drawn", () => {
  const document = aDocument();
  document.edges.push({
    id: "e2",
    source: "c",
    source_port: "done",
    target: "a",
    target_port: "start",
  });
  expect(orderSteps(document)).toEqual(["c", "a", "b"]);
});

test("the connect menu lists every other input with its reason", () => {
  const targets = findTargets(palette, aDocument(), { step: "a", port: "done" });
  expect(targets.filter((target) => target.reason === null).map((t) => t.into.step)).toEqual(["c"]);
  expect(targets).toHaveLength(4);
});

test("an unknown kind is a finding, and the step is kept", () => {
  const document = aDocument();
  const [first] = document.steps;
  if (first) first.kind = "distill";
  expect(checkGraph(palette, document).map((finding) => finding.code)).toContain(
    "protocol.unknown_kind",
  );
});
