/** The graph of a rig, with the route of one step on it. */

import "@xyflow/react/dist/style.css";
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
import { layoutBoxes } from "@/model/layout";
import { claimText, linksOf } from "@/model/recipe";
import type { PlannedStep, Rig, RigNode } from "@/model/wirerecipe";
import { Card } from "@/ui/card";
import { Icon, type IconName } from "@/ui/icons";
import { words } from "./words";

const WIDTH = 148;
const HEIGHT = 40;
const ICONS: Record<string, IconName> = {
  vessel: "flask",
  valve: "valve",
  solenoid: "valve",
  pump: "pump",
  cartridge: "filter",
};

interface BoxData extends Record<string, unknown> {
  node: RigNode;
  /** On the route, off it, or there is none. */
  state: "on" | "off" | "plain";
}

function RigBox({ data }: NodeProps<Node<BoxData>>) {
  const { node, state } = data;
  return (
    <article className={`rigbox ${state}`} data-node={node.key} data-state={state}>
      <Icon name={ICONS[node.role] ?? "devices"} />
      <span className="tx2">
        <span className="b cut">{node.key}</span>
        <span className="t12 m cut">{node.chemical || node.sort || node.kind}</span>
      </span>
      <Handle type="target" position={Position.Left} className="quiet" isConnectable={false} />
      <Handle type="source" position={Position.Right} className="quiet" isConnectable={false} />
    </article>
  );
}

const nodeTypes = { rig: RigBox };

function useLayout(rig: Rig) {
  const links = useMemo(() => linksOf(rig), [rig]);
  const joined = useMemo(() => new Set(links.flatMap((one) => [one.source, one.target])), [links]);
  const places = useMemo(
    () =>
      layoutBoxes(
        rig.nodes
          .filter((node) => joined.has(node.key))
          .map((node) => ({ id: node.key, width: WIDTH, height: HEIGHT })),
        links,
        { rank: 48, node: 14 },
      ),
    [rig, links, joined],
  );
  return { links, joined, places };
}

/** The graph laid out once, and lit anew for each step. */
function useGraph(rig: Rig, step: PlannedStep | null): [Node<BoxData>[], Edge[]] {
  const { links, joined, places } = useLayout(rig);
  const on = useMemo(() => new Set(step?.route ?? []), [step]);
  const edges = useMemo(
    () =>
      links.map((link): Edge => {
        const isOn = link.tubes.some((tube) => on.has(tube.key));
        return {
          id: link.id,
          source: link.source,
          target: link.target,
          className: `rigedge ${isOn ? "on" : ""}`,
          zIndex: isOn ? 1 : 0,
          focusable: false,
          data: { isOn },
        };
      }),
    [links, on],
  );
  const nodes = useMemo(() => {
    const met = new Set(
      links
        .filter((one) => one.tubes.some((t) => on.has(t.key)))
        .flatMap((l) => [l.source, l.target]),
    );
    const state = (key: string): BoxData["state"] =>
      met.size ? (met.has(key) ? "on" : "off") : "plain";
    return rig.nodes
      .filter((node) => joined.has(node.key))
      .map((node): Node<BoxData> => ({
        id: node.key,
        type: "rig",
        position: places.get(node.key) ?? { x: 0, y: 0 },
        width: WIDTH,
        data: { node, state: state(node.key) },
        ariaLabel: `${node.key}, ${node.sort ?? node.kind}`,
        selectable: false,
        focusable: false,
      }));
  }, [rig, links, places, joined, on]);
  return [nodes, edges];
}

export function RigGraph({ rig, step }: { rig: Rig; step: PlannedStep | null }) {
  const [nodes, edges] = useGraph(rig, step);
  return (
    <Card
      title={words.graphTitle}
      note={`${nodes.length} of ${rig.nodes.length} joined`}
      testId="rig-graph"
    >
      <div className="lgraph riggraph">
        <ReactFlow
          key={rig.sha256}
          nodes={nodes}
          edges={edges}
          nodeTypes={nodeTypes}
          nodesDraggable={false}
          nodesConnectable={false}
          edgesFocusable={false}
          zoomOnScroll={false}
          preventScrolling={false}
          minZoom={0.1}
          deleteKeyCode={null}
          onlyRenderVisibleElements={nodes.length > 200}
          fitView
          fitViewOptions={{ maxZoom: 1, padding: 0.06 }}
          attributionPosition="bottom-left"
        >
          <Background gap={16} size={1.2} color="var(--line-2)" bgColor="var(--sunken)" />
        </ReactFlow>
      </div>
      <p className="help routewords" role="status">
        {step ? `${step.id}. ${claimText(step.does)}` : words.pickStep}
      </p>
    </Card>
  );
}
