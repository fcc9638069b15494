/** The lab as a tree: what stands where, and what it holds. */

import "./lab.css";
import { useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useResources } from "@/api/queries";
import { Card, Loaded } from "@/ui/card";
import { ResourceInspector } from "./inspector";
import { ResourceTree } from "./tree";
import { words } from "./words";

export function LabPage() {
  const resources = useResources();
  const [params, setParams] = useSearchParams();
  const picked = params.get("sel");
  useTopics("events", "devices");
  return (
    <div className="wrap labpage" data-testid="lab">
      <div className="hd">
        <h1>{words.tree.title}</h1>
      </div>
      <Card title="Resources" note={resources.data ? String(resources.data.length) : null}>
        <Loaded source={resources} what="resources">
          {(rows) => (
            <ResourceTree
              rows={rows}
              picked={picked}
              onPick={(id) => setParams({ sel: id }, { replace: true })}
            />
          )}
        </Loaded>
      </Card>
      <section className="card rcard" aria-label="Resource">
        <ResourceInspector id={picked} />
      </section>
    </div>
  );
}
