/** Where a recipe does not fit: the fewest changes of the graph, and the graph with them. */

import { useEffect, useMemo } from "react";
import { useOpened } from "@/api/opened";
import { useAdvice, type RecipeAsked } from "@/api/recipes";
import { sentence } from "@/model/format";
import type { RecipeAdvice } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Button, Refused } from "@/ui/controls";
import { Icon } from "@/ui/icons";
import { words } from "./words";

export function AdviceCard({ asked }: { asked: RecipeAsked }) {
  const advice = useAdvice();
  return (
    <Card
      title={words.advice}
      testId="advice"
      actions={
        <Button
          disabled={advice.isPending}
          onClick={() => advice.mutate(asked)}
          testId="ask-advice"
        >
          {advice.isPending ? words.advising : words.advise}
        </Button>
      }
    >
      <div className="advice" aria-live="polite" aria-busy={advice.isPending}>
        <Refused error={advice.error} />
        {advice.data && <Told advice={advice.data} name={asked.name} />}
      </div>
    </Card>
  );
}

function Told({ advice, name }: { advice: RecipeAdvice; name: string }) {
  if (!advice.ok) {
    return (
      <>
        <p>{words.noAdvice}</p>
        <ul className="m">
          {advice.findings.map((finding, place) => (
            <li key={place}>{sentence(finding.message)}</li>
          ))}
        </ul>
      </>
    );
  }
  return (
    <>
      <p className="tone-ok b">{words.advised}</p>
      <ol className="changes">
        {advice.changes.map((change, place) => (
          <li key={place} data-testid="advised-change">
            {change.text}
          </li>
        ))}
      </ol>
      <Corrected graph={advice.graph} file={`${name}-corrected.json`} />
    </>
  );
}

function Corrected({ graph, file }: { graph: string; file: string }) {
  const addGraph = useOpened((state) => state.addGraph);
  const blob = useMemo(() => new Blob([graph], { type: "application/json" }), [graph]);
  const url = useMemo(() => URL.createObjectURL(blob), [blob]);
  useEffect(() => () => URL.revokeObjectURL(url), [url]);
  return (
    <div className="acts">
      <a className="btn" href={url} download={file} data-testid="corrected-graph">
        <Icon name="download" />
        {words.download}
      </a>
      <Button
        look="pri"
        testId="try-corrected"
        onClick={() => void addGraph(new File([blob], file, { type: blob.type }))}
      >
        {words.tryIt}
      </Button>
    </div>
  );
}
