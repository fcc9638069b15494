/** What stands against a plan, each finding with its line. */

import { lineOf } from "@/model/recipe";
import type { RecipeFinding } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { words } from "./words";

export function FindingsCard(props: {
  findings: readonly RecipeFinding[];
  onLine: (line: number) => void;
}) {
  return (
    <Card title={words.findings} note={String(props.findings.length)} testId="recipe-findings">
      <ul className="rfindings">
        {props.findings.map((finding, place) => (
          <li key={place} data-testid="recipe-finding" data-code={finding.code}>
            <Where finding={finding} onLine={props.onLine} />
            <span className="tx2">
              <span>{finding.message}</span>
              <span className="mono m">{finding.code}</span>
              <GiveValue finding={finding} />
            </span>
          </li>
        ))}
      </ul>
    </Card>
  );
}

/** Leads to the field of the parameter that a finding is about. */
function GiveValue({ finding }: { finding: RecipeFinding }) {
  const { parameter } = finding.context;
  if (typeof parameter !== "string") return null;
  const wanted = `[data-parameter="${CSS.escape(parameter)}"] input`;
  return (
    <button
      type="button"
      className="link"
      data-testid="give-value"
      onClick={() => document.querySelector<HTMLInputElement>(wanted)?.focus()}
    >
      {words.giveValue(parameter)}
    </button>
  );
}

function Where(props: { finding: RecipeFinding; onLine: (line: number) => void }) {
  const { finding } = props;
  const line = lineOf(finding);
  if (finding.about === "declared") {
    const at = line === null ? finding.context.at : `line ${line}`;
    return (
      <span className="t12 m">
        {words.about.declared}
        {typeof at === "string" && `, ${at}`}
      </span>
    );
  }
  if (line === null) {
    return <span className="t12 m">{finding.subject || words.about[finding.about]}</span>;
  }
  const column = finding.context.column;
  return (
    <button type="button" className="link num" onClick={() => props.onLine(line)}>
      Line {line}
      {typeof column === "number" && `, ${column}`}
    </button>
  );
}
