/** The connections of a step in words, so that each can be taken away without the canvas. */

import { removeEdges } from "@/model/document";
import type { WorkflowEdge, WorkflowStep } from "@/model/wire";
import { IconButton } from "@/ui/controls";
import { Group } from "./fields";
import { useDocument, useEditor } from "./store";
import { words } from "./words";

export function ConnectionsOf({ step }: { step: WorkflowStep }) {
  const { steps, edges } = useDocument();
  const canEdit = useEditor((state) => state.canEdit);
  const edit = useEditor((state) => state.edit);
  const own = edges.filter((edge) => edge.source === step.id || edge.target === step.id);
  if (!own.length) return null;
  const place = (id: string): number => steps.findIndex((one) => one.id === id) + 1;
  const text = (edge: WorkflowEdge): string => {
    const [from, to] = [`step ${place(edge.source)}`, `step ${place(edge.target)}`];
    const isOrder = edge.source_port === "done" && edge.target_port === "start";
    if (isOrder) return edge.target === step.id ? `Starts after ${from}` : `Leads to ${to}`;
    return `${edge.source_port} of ${from} goes to ${edge.target_port} of ${to}`;
  };
  return (
    <Group title={`${words.editor.connections} (${own.length})`}>
      <ul className="links" data-testid="connections">
        {own.map((edge) => (
          <li key={edge.id}>
            <span>{text(edge)}</span>
            {canEdit && (
              <IconButton
                icon="close"
                label={`Remove this connection: ${text(edge)}`}
                onClick={() => edit(removeEdges([edge.id]))}
              />
            )}
          </li>
        ))}
      </ul>
    </Group>
  );
}
