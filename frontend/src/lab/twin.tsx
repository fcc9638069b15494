/** The twin: the tree as its accessible equal, the scene, and what is selected. */

import "./lab.css";
import { useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useResources } from "@/api/queries";
import { TwinChip, TwinFrame } from "@/twin/frame";
import { Loaded } from "@/ui/card";
import { ResourceInspector } from "./inspector";
import { ResourceTree } from "./tree";

export function TwinPage() {
  const resources = useResources();
  const [params, setParams] = useSearchParams();
  const picked = params.get("sel");
  useTopics("events", "devices");
  return (
    <div className="twinpage" data-testid="twin-page" data-twin-sel={picked ?? ""}>
      <aside className="tpane" aria-label="Resources">
        <div className="tphead">
          <h1>Twin</h1>
          <TwinChip />
        </div>
        <Loaded source={resources} what="resources">
          {(rows) => (
            <ResourceTree
              rows={rows}
              picked={picked}
              isNarrow
              onPick={(id) => setParams({ sel: id }, { replace: true })}
            />
          )}
        </Loaded>
      </aside>
      <TwinFrame title="Twin of the lab" />
      <aside className="tpane right" aria-label="Selected resource">
        <ResourceInspector id={picked} isShort />
      </aside>
    </div>
  );
}
