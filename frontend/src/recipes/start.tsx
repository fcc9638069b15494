/** Whether the workflow of a recipe would start in the lab as it is now, and what is in its way. */

import { useTopics } from "@/api/live";
import { useStart } from "@/api/recipes";
import { sentenceText } from "@/model/sentence";
import type { CheckResult } from "@/model/wire";
import type { Opening } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { words } from "./words";

export function StartNow(props: { opening: Opening; openedAt: number }) {
  useTopics("events", "devices");
  const start = useStart(props.opening.document, props.openedAt);
  if (props.opening.document === null) return null;
  if (start.isPending) {
    return (
      <p className="m" role="status" data-testid="start-now" data-state="asking">
        {words.start.asking}
      </p>
    );
  }
  if (start.error) return <Refused error={start.error} />;
  return <Told result={start.data} />;
}

function Told({ result }: { result: CheckResult }) {
  const starts = result.plan !== null;
  return (
    <>
      <p
        className={`ts b ${starts ? "tone-ok" : "tone-needs"}`}
        role="status"
        data-testid="start-now"
        data-state={starts ? "starts" : "refused"}
      >
        <Glyph look={starts ? "ok" : "needs"} />
        {starts ? words.start.starts : words.start.refused}
        {result.policies.length > 0 && (
          <span className="m"> {words.start.policies(result.policies)}</span>
        )}
      </p>
      {!starts && (
        <Card title={words.start.why} note={String(result.findings.length)} testId="start-findings">
          <ul className="rfindings">
            {result.findings.map((finding, place) => (
              <li key={place} data-testid="start-finding" data-code={finding.code}>
                <span className="tx2">
                  {result.sentences[finding.subject] && (
                    <span className="b">
                      {sentenceText(result.sentences[finding.subject] ?? [])}
                    </span>
                  )}
                  <span>{finding.message}</span>
                  <span className="mono m">{finding.code}</span>
                </span>
              </li>
            ))}
          </ul>
        </Card>
      )}
    </>
  );
}
