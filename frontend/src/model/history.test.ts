import { expect, test } from "vitest";
import {
  addStep,
  connect,
  copySteps,
  freeStepId,
  makeStep,
  moveSteps,
  pasteClip,
  removeEdges,
  renameWorkflow,
  reorderStep,
  setNote,
  setParam,
  type Edit,
} from "./document";
import { applyEdit, redo, startHistory, undo, undoLabel, type History } from "./history";
import { removeSteps } from "./removing";
import { aDocument } from "./samples";

/** Numbers that look random and are the same each time. */
function dice(seed: number): (sides: number) => number {
  let state = seed;
  return (sides) => {
    state = (state * 1_103_515_245 + 12_345) % 2_147_483_648;
    return state % sides;
  };
}

function anEdit(history: History, roll: (sides: number) => number): Edit {
  const { document } = history;
  const step = document.steps[roll(document.steps.length)];
  const other = document.steps[roll(document.steps.length)];
  const edge = document.edges[roll(Math.max(1, document.edges.length))];
  const fresh = makeStep(
    freeStepId(document, "wait"),
    "wait",
    { duration: "1 min" },
    { x: roll(900), y: 9 },
  );
  if (!step || !other) return addStep(fresh, "Wait", null);
  switch (roll(11)) {
    case 0:
      return addStep(fresh, "Wait", step.id);
    case 1:
      return removeSteps([step.id]);
    case 2:
      return connect({ step: step.id, port: "done" }, { step: other.id, port: "start" });
    case 3:
      return edge ? removeEdges([edge.id]) : renameWorkflow(`n${roll(99)}`);
    case 4:
      return setParam(step.id, "volume", "volume", `${roll(50)} mL`);
    case 5:
      return setParam(step.id, "source", "source", undefined);
    case 6:
      return moveSteps(new Map([[step.id, { x: roll(900), y: roll(600) }]]));
    case 7:
      return renameWorkflow(`Name ${roll(1000)}`);
    case 8:
      return setNote(step.id, roll(2) ? `note ${roll(99)}` : "");
    case 9:
      return reorderStep(step.id, roll(2) ? 1 : -1);
    default:
      return pasteClip(document, copySteps(document, [step.id, other.id])).edit;
  }
}

test.each([1, 7, 42, 418, 2026])(
  "thirty mixed edits undone one by one give the same bytes, and redone too (seed %i)",
  (seed) => {
    const roll = dice(seed);
    let history = startHistory(aDocument());
    const states = [JSON.stringify(history.document)];
    for (let done = 0, tries = 0; done < 30 && tries < 500; tries += 1) {
      const next = applyEdit(history, anEdit(history, roll), tries * 10);
      if (next === history) continue;
      history = next;
      done += 1;
      states.push(JSON.stringify(history.document));
    }
    expect(states).toHaveLength(31);
    for (let at = 29; at >= 0; at -= 1) {
      history = undo(history);
      expect(JSON.stringify(history.document)).toBe(states[at]);
    }
    expect(history.past).toHaveLength(0);
    for (let at = 1; at <= 30; at += 1) {
      history = redo(history);
      expect(JSON.stringify(history.document)).toBe(states[at]);
    }
  },
);

test("typing in one field is one step of undo while it does not pause", () => {
  let history = startHistory(aDocument());
  for (const [text, at] of [
    ["8 mL", 0],
    ["8. mL", 0.4],
    ["8.5 mL", 0.9],
  ] as const) {
    history = applyEdit(history, setParam("a", "volume", "volume", text), at);
  }
  expect(history.past).toHaveLength(1);
  expect(undoLabel(history)).toBe("set volume");
  history = applyEdit(history, setParam("a", "volume", "volume", "9 mL"), 20);
  expect(history.past).toHaveLength(2);
  expect(undo(undo(history)).document).toEqual(aDocument());
});

test("an edit that changes nothing leaves no trace", () => {
  const history = startHistory(aDocument());
  expect(applyEdit(history, renameWorkflow("Two transfers"), 0)).toBe(history);
});

test("a new edit after undo forgets what could have been redone", () => {
  let history = applyEdit(startHistory(aDocument()), renameWorkflow("x"), 0);
  history = applyEdit(undo(history), renameWorkflow("y"), 10);
  expect(redo(history)).toBe(history);
});

test("pasted steps get new ids and keep the connections among them", () => {
  const document = aDocument();
  const { edit, ids } = pasteClip(document, copySteps(document, ["a", "b"]));
  const after = applyEdit(startHistory(document), edit, 0).document;
  expect(ids).toEqual(["transfer_1", "transfer_2"]);
  expect(after.steps).toHaveLength(5);
  expect(after.edges.at(-1)).toMatchObject({ source: "transfer_1", target: "transfer_2" });
});
