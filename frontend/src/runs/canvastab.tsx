/** The workflow of a run, read-only, each step with its state. */

import "@xyflow/react/dist/style.css";
import "@/editor/editor.css";
import {
  Background,
  Handle,
  Position,
  ReactFlow,
  type Edge,
  type Node,
  type NodeProps,
} from "@xyflow/react";
import { useMemo } from "react";
import { useResources, useSteps } from "@/api/queries";
import { makePalette, portKind } from "@/model/document";
import { formatDuration } from "@/model/format";
import { openDocument } from "@/model/opening";
import { deviceName, type StepProgress } from "@/model/runs";
import { namesOf, sentenceOf } from "@/model/sentence";
import { capitalise } from "@/model/states";
import type { Run, SentencePart } from "@/model/wire";
import { Sentence } from "@/editor/node";
import { Icon, iconOf } from "@/ui/icons";
import { StateGlyph } from "@/ui/state";

interface StepData extends Record<string, unknown> {
  progress: StepProgress;
  parts: SentencePart[];
}

function RunNode({ data }: NodeProps<Node<StepData>>) {
  const { progress, parts } = data;
  const devices = [...new Set(progress.jobs.map(deviceName))].join(", ");
  const state = { look: progress.look, word: capitalise(progress.state) };
  return (
    <article
      className={`node rnode ${progress.state}`}
      data-step={progress.step.step_id}
      data-state={progress.state}
    >
      <header>
        <Icon name={iconOf(progress.step.kind)} />
        <p>
          <Sentence parts={parts} />
        </p>
      </header>
      <div className="nb cut">{devices}</div>
      <footer>
        <span className="find0">
          <StateGlyph state={state} /> {state.word}
        </span>
        <i className="sp" />
        <span className="m num">{formatDuration(progress.step.estimate_s)}</span>
      </footer>
      <Handle type="target" position={Position.Left} className="quiet" isConnectable={false} />
      <Handle type="source" position={Position.Right} className="quiet" isConnectable={false} />
    </article>
  );
}

const nodeTypes = { run: RunNode };

type Kinds = ReturnType<typeof makePalette>;
type Document = Run["document"];

function useNodes(document: Document, steps: StepProgress[], kinds: Kinds): Node<StepData>[] {
  const resources = useResources().data;
  const names = useMemo(() => namesOf(resources ?? []), [resources]);
  return useMemo(
    () =>
      document.steps.flatMap((step): Node<StepData>[] => {
        const progress = steps.find((item) => item.step.step_id === step.id);
        if (!progress) return [];
        const parts = kinds.size
          ? sentenceOf(kinds.get(step.kind), step, names)
          : [{ text: progress.step.sentence }];
        return [
          {
            id: step.id,
            type: "run",
            position: step.position,
            width: 212,
            data: { progress, parts },
            ariaLabel: progress.step.sentence,
          },
        ];
      }),
    [document, steps, kinds, names],
  );
}

function useEdges(document: Document, kinds: Kinds): Edge[] {
  return useMemo(
    () =>
      document.edges.map((edge): Edge => {
        const kind = portKind(
          kinds,
          document,
          { step: edge.source, port: edge.source_port },
          "out",
        );
        return {
          id: edge.id,
          source: edge.source,
          target: edge.target,
          className: `wire ${kind ?? "done"}`,
        };
      }),
    [document, kinds],
  );
}

export function RunCanvas({ run, steps }: { run: Run; steps: StepProgress[] }) {
  const palette = useSteps().data;
  const kinds = useMemo(() => makePalette(palette?.steps ?? []), [palette]);
  const document = useMemo(() => openDocument(run.document).document, [run.document]);
  const nodes = useNodes(document, steps, kinds);
  const edges = useEdges(document, kinds);
  return (
    <section className="card runcanvas" aria-label="Canvas" data-mode={run.mode}>
      <ReactFlow
        nodes={nodes}
        edges={edges}
        nodeTypes={nodeTypes}
        nodesDraggable={false}
        nodesConnectable={false}
        edgesFocusable={false}
        deleteKeyCode={null}
        fitView
        fitViewOptions={{ maxZoom: 1, padding: 0.08 }}
        attributionPosition="bottom-left"
      >
        <Background gap={16} size={1.2} color="var(--line-2)" bgColor="var(--sunken)" />
      </ReactFlow>
    </section>
  );
}
