import { describe, expect, it } from "vitest";
import { orderedChoices, readValue, whyNotSend } from "./recovery";
import type { RecoveryChoice } from "./wire";

const choice = (name: RecoveryChoice["name"], why_not: string | null = null): RecoveryChoice => ({
  name,
  why_not,
  consequence: "",
});
const draft = { choice: null, note: "", ul: null, changed: {}, asked_ul: null };

describe("recovery", () => {
  it("puts trying again last among the offered after two failures", () => {
    const choices = [choice("retry"), choice("skip"), choice("change", "moved already")];
    expect(orderedChoices({ choices, tries: 1 }).map((one) => one.name)).toEqual([
      "retry",
      "skip",
      "change",
    ]);
    expect(orderedChoices({ choices, tries: 2 }).map((one) => one.name)).toEqual([
      "skip",
      "retry",
      "change",
    ]);
  });

  it("asks for choice, amount, change and note before it is sent", () => {
    expect(whyNotSend(draft)).toBe("Choose first.");
    expect(whyNotSend({ ...draft, choice: "done_by_hand", asked_ul: 5 })).toMatch(/how much/);
    expect(whyNotSend({ ...draft, choice: "change" })).toMatch(/Change a value/);
    expect(whyNotSend({ ...draft, choice: "skip" })).toBe("Write why.");
    expect(whyNotSend({ ...draft, choice: "skip", note: "broken" })).toBeNull();
    expect(whyNotSend({ ...draft, choice: "done_by_hand", note: "done" })).toBeNull();
  });

  it("reads a value in the sort that it had", () => {
    expect(readValue("4", 3)).toBe(4);
    expect(readValue("4 mL", "3 mL")).toBe("4 mL");
    expect(readValue("oops", 3)).toBe("oops");
  });
});
