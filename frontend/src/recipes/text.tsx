/** The recipe as written, line by line. */

import { useEffect, useMemo, useRef, type KeyboardEvent } from "react";
import { lineOf, linesOf } from "@/model/recipe";
import type { RecipeFinding } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { words } from "./words";

const MOST_LINES = 4000;

export function RecipeText(props: {
  text: string;
  findings: readonly RecipeFinding[];
  marked: number | null;
  /** A person asked for the marked line: it takes the focus. */
  isWanted: boolean;
  onLine: (line: number) => void;
}) {
  const lines = useMemo(() => linesOf(props.text), [props.text]);
  const bad = useMemo(() => {
    const found = new Map<number, string[]>();
    for (const finding of props.findings) {
      const line = lineOf(finding);
      if (line !== null) found.set(line, [...(found.get(line) ?? []), finding.message]);
    }
    return found;
  }, [props.findings]);
  const list = useRef<HTMLOListElement>(null);
  const { marked, isWanted } = props;
  useEffect(() => {
    const frame = list.current;
    const found = frame?.querySelector<HTMLElement>(`[data-line="${marked ?? 0}"]`);
    if (!frame || !found) return;
    const below = found.getBoundingClientRect().top - frame.getBoundingClientRect().top;
    frame.scrollTop += below - frame.clientHeight / 3;
    if (isWanted) found.focus();
  }, [marked, isWanted]);
  return (
    <Card title={words.text} note={`${lines.length} lines`}>
      <ol className="xdl" ref={list} data-testid="recipe-text">
        {lines.slice(0, MOST_LINES).map((line, place) => {
          const number = place + 1;
          const wrong = bad.get(number);
          return (
            <li key={number}>
              <button
                type="button"
                data-line={number}
                className={wrong ? "bad" : ""}
                aria-current={number === marked ? true : undefined}
                aria-label={`Line ${number}: ${line.trim()}${wrong ? `. ${wrong.join(" ")}` : ""}`}
                tabIndex={number === (marked ?? 1) ? 0 : -1}
                onClick={() => props.onLine(number)}
                onKeyDown={(event) => step(event, number)}
              >
                <span className="no num">{number}</span>
                <code>{line}</code>
              </button>
              {wrong?.map((message) => (
                <p key={message} className="help bad">
                  {message}
                </p>
              ))}
            </li>
          );
        })}
      </ol>
    </Card>
  );
}

/** The arrows go from line to line; Tab leaves the text. */
function step(event: KeyboardEvent<HTMLElement>, number: number): void {
  const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!by) return;
  const list = event.currentTarget.closest("ol");
  const next = list?.querySelector<HTMLElement>(`[data-line="${number + by}"]`);
  if (!next) return;
  event.preventDefault();
  next.focus();
}
