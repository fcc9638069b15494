/** Every run, newest first. */

import { useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useRuns } from "@/api/queries";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button, Segments } from "@/ui/controls";
import { countOf, More } from "@/ui/more";
import { RunTable } from "@/ui/runtable";
import { words } from "./words";

const FILTERS = [
  { value: "", label: "All" },
  { value: "queued,running,pausing,paused,completing", label: "Under way" },
  { value: "awaiting_approval", label: "Awaiting approval" },
  { value: "complete", label: "Complete" },
  { value: "aborted", label: "Aborted" },
] as const;

export function RunsPage() {
  const [params, setParams] = useSearchParams();
  const state = params.get("state") ?? "";
  const runs = useRuns(state);
  useTopics("runs");
  const choose = (value: string): void =>
    setParams(value ? { state: value } : {}, { replace: true });
  return (
    <div className="wrap" data-testid="runs">
      <div className="hd wrapping">
        <h1>{words.title}</h1>
        <i className="sp" />
        <Segments label="Show" value={state} options={FILTERS} onChange={choose} />
      </div>
      <Card title={words.title} note={countOf(runs)}>
        <Loaded source={runs} what="runs">
          {(rows) =>
            rows.length ? (
              <>
                <RunTable runs={rows} isHistory />
                <More list={runs} what="runs" />
              </>
            ) : (
              <Empty>
                {state ? words.none : words.noneYet}
                {state && <Button onClick={() => choose("")}>{words.clear}</Button>}
              </Empty>
            )
          }
        </Loaded>
      </Card>
    </div>
  );
}
