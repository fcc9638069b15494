/** A doubt being answered: what is offered, and what the device reads otherwise. */

import { THIN } from "./format";
import type { Measured, Question, RecoveryChoice, Resolution } from "./wire";

export type AnswerKind = "happened" | "did_not" | "partly" | "discard";
export type ThenAct = "" | "retry" | "skip" | "done_by_hand" | "abort";

/** What the form begins with: the answer that agrees with the readings, and nothing guessed. */
export function prefillOf(question: Question): { kind: AnswerKind | null; amount: string } {
  const measured = question.measured;
  const kind = measured?.answer ?? null;
  const moved = measured?.moved_ul ?? null;
  const amount = kind === "partly" && moved !== null ? millilitres(moved) : "";
  return { kind, amount };
}

const NANOLITRE_DIGITS = 6;
const SHOWN_DIGITS = 3;

/** Microlitres as the text of a field in millilitres; no nanolitre is lost. */
function millilitres(ul: number): string {
  const exact = (ul / 1000).toFixed(NANOLITRE_DIGITS);
  const short = (ul / 1000).toFixed(SHOWN_DIGITS);
  return Number(short) === Number(exact) ? short : exact;
}

/** Whether the device reads otherwise; the server has subtracted, and refuses by the same limits. */
export function contradicts(
  measured: Measured | null,
  kind: AnswerKind | null,
  ul: number | null,
): boolean {
  if (!measured || measured.moved_ul === null || kind === null) return false;
  if (kind !== "partly") return measured.contradicts.some((one) => one === kind);
  return ul !== null && Math.abs(ul - measured.moved_ul) > measured.tolerance_ul;
}

/** What may follow an answer; nothing does after one that leaves no action undone. */
export function choicesThen(question: Question, kind: AnswerKind | null): RecoveryChoice[] {
  return kind === null || kind === "happened" ? [] : (question.then[kind] ?? []);
}

const ANSWERS: Record<string, string> = {
  happened: "it happened",
  did_not: "it did not happen",
  discard: "nobody can tell",
};

/** How a doubt ended: what, by whom, and both times. */
export function resolutionText(told: Resolution, clock: (at: number) => string): string {
  const at = (text: string | null | undefined): string =>
    text ? clock(new Date(text).getTime() / 1000) : "";
  const answer =
    told.answer === "partly" && typeof told.moved_nl === "number"
      ? `partly, ${(told.moved_nl / 1e6).toFixed(SHOWN_DIGITS)}${THIN}mL moved`
      : (ANSWERS[told.answer] ?? told.answer.replaceAll("_", " "));
  return [
    `${told.by ? `${told.by}: ` : ""}${answer}${told.despite_reading ? ", despite the reading" : ""}`,
    told.at ? `resolved ${at(told.at)}` : "",
    told.doubt_at ? `asked ${at(told.doubt_at)}` : "",
    told.note,
  ]
    .filter(Boolean)
    .join("; ");
}
