/** Where what is in a vessel came from and where it went: as a graph, and as a table. */

import "@xyflow/react/dist/style.css";
import "./lab.css";
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
import { Link, useNavigate, useParams, useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useLineage, useResource } from "@/api/queries";
import { formatVolume } from "@/model/format";
import { layoutBoxes } from "@/model/layout";
import { capitalise } from "@/model/states";
import type { Lineage, LineageNode } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { PageState } from "@/ui/pagestate";
import { Segments } from "@/ui/controls";
import { Icon, type IconName } from "@/ui/icons";
import { At } from "@/ui/time";

/** The answer as a document that other programs read. */
function Export({ id, direction, depth }: { id: string; direction: string; depth: number }) {
  const query = new URLSearchParams({ direction, depth: String(depth), form: "prov" });
  return (
    <a
      className="btn wide"
      href={`/api/v1/resources/${id}/provenance?${query.toString()}`}
      download={`provenance-${id}.json`}
      title="Lots, vessels, acts, people, devices and driver versions as PROV-JSON"
      data-testid="prov"
    >
      <Icon name="download" />
      PROV-JSON
    </a>
  );
}

const DIRECTIONS = [
  { value: "up", label: "Came from" },
  { value: "both", label: "Both" },
  { value: "down", label: "Went to" },
] as const;
const DEPTHS = ["1", "2", "3", "4", "6"].map((value) => ({ value, label: value }));
const ICONS: Record<string, IconName> = {
  vessel: "flask",
  lot: "drop",
  job: "runs",
  receipt: "plus",
};

export function LineagePage() {
  const { id = "" } = useParams();
  const [params, setParams] = useSearchParams();
  const direction = params.get("dir") ?? "both";
  const depth = Number(params.get("depth") ?? "2");
  const lineage = useLineage(id, direction, depth);
  const resource = useResource(id);
  useTopics("events");
  if (!resource.data) {
    return <PageState of="resource" error={resource.error} retry={resource.refetch} />;
  }
  const set = (name: string, value: string): void => {
    params.set(name, value);
    setParams(params, { replace: true });
  };
  return (
    <div className="wrap" data-testid="lineage">
      <div className="hd wrapping">
        <Link className="crumb m" to={`/lab?sel=${id}`}>
          Lab
        </Link>
        <span className="m">/</span>
        <h1>Lineage of {resource.data.name}</h1>
        <i className="sp" />
        <Segments
          label="Direction"
          value={direction}
          options={DIRECTIONS}
          onChange={(value) => set("dir", value)}
        />
        <Segments
          label="Depth"
          value={String(depth)}
          options={DEPTHS}
          onChange={(value) => set("depth", value)}
        />
        <Export id={id} direction={direction} depth={depth} />
      </div>
      <Loaded source={lineage} what="the lineage">
        {(data) =>
          data.edges.length ? (
            <>
              <Graph lineage={data} />
              <LineageTable lineage={data} />
            </>
          ) : (
            <Card title="Lineage">
              <Empty>Nothing came in or went out yet.</Empty>
            </Card>
          )
        }
      </Loaded>
    </div>
  );
}

/** Name of a thing, or of an act with how much it moved: Transfer 5.00 mL. */
function nodeName(node: LineageNode, lineage: Lineage): string {
  if (node.kind === "entity") return node.name;
  const amount = (end: "source" | "target"): number =>
    lineage.edges
      .filter((edge) => edge[end] === node.id)
      .reduce((sum, edge) => sum + (edge.amount_nl ?? 0), 0);
  const moved = Math.max(amount("source"), amount("target"));
  return capitalise(node.name) + (moved > 0 ? ` ${formatVolume(moved)}` : "");
}

interface BoxData extends Record<string, unknown> {
  node: LineageNode;
  name: string;
  isRoot: boolean;
  isDownwards: boolean;
}

const words = (node: LineageNode): string => (node.detail || node.type).replaceAll("_", " ");

function LineageBox({ data }: NodeProps<Node<BoxData>>) {
  const { node, name, isRoot, isDownwards } = data;
  const [entry, exit] = isDownwards
    ? [Position.Top, Position.Bottom]
    : [Position.Left, Position.Right];
  return (
    <article className={`lbox ${node.kind} ${isRoot ? "root" : ""}`} data-kind={node.kind}>
      <Icon name={ICONS[node.type] ?? "flask"} />
      <span className="tx2">
        <span className="b cut">{name}</span>
        <span className="t12 m cut">
          {node.at ? <At at={node.at} seconds /> : capitalise(words(node))}
        </span>
      </span>
      <Handle type="target" position={entry} className="quiet" isConnectable={false} />
      <Handle type="source" position={exit} className="quiet" isConnectable={false} />
    </article>
  );
}

const nodeTypes = { box: LineageBox };
const WIDTH = 188;
const HEIGHT = 48;

function Graph({ lineage }: { lineage: Lineage }) {
  const navigate = useNavigate();
  const isDownwards = matchMedia("(max-width: 640px)").matches;
  const [nodes, edges] = useMemo((): [Node<BoxData>[], Edge[]] => {
    const places = layoutBoxes(
      lineage.nodes.map((node) => ({ id: node.id, width: WIDTH, height: HEIGHT })),
      lineage.edges,
      { rank: isDownwards ? 36 : 88, node: 20 },
      isDownwards ? "TB" : "LR",
    );
    const boxes = lineage.nodes.map((node): Node<BoxData> => ({
      id: node.id,
      type: "box",
      position: places.get(node.id) ?? { x: 0, y: 0 },
      width: WIDTH,
      data: { node, name: nodeName(node, lineage), isRoot: node.id === lineage.root, isDownwards },
      ariaLabel: `${capitalise(node.type)} ${nodeName(node, lineage)}`,
    }));
    const wires = lineage.edges.map((edge, place): Edge => ({
      id: `${edge.source}-${edge.target}-${place}`,
      source: edge.source,
      target: edge.target,
      className: "wire done",
      label: edge.amount_nl === null ? edge.label : formatVolume(edge.amount_nl),
    }));
    return [boxes, wires];
  }, [lineage, isDownwards]);
  return (
    <Card
      title="Graph"
      note={lineage.truncated ? `${lineage.truncated} more beyond this depth` : null}
    >
      <div className="lgraph">
        <ReactFlow
          key={nodes.map((node) => node.id).join()}
          nodes={nodes}
          edges={edges}
          nodeTypes={nodeTypes}
          nodesDraggable={false}
          nodesConnectable={false}
          edgesFocusable={false}
          deleteKeyCode={null}
          fitView
          fitViewOptions={{ minZoom: 0.6, maxZoom: 1, padding: 0.06 }}
          onNodeClick={(_, node) => {
            if (node.data.node.type === "vessel") void navigate(`/lineage/${node.id}`);
          }}
          attributionPosition="bottom-left"
        >
          <Background gap={16} size={1.2} color="var(--line-2)" bgColor="var(--sunken)" />
        </ReactFlow>
      </div>
    </Card>
  );
}

function LineageTable({ lineage }: { lineage: Lineage }) {
  const names = new Map(lineage.nodes.map((node) => [node.id, node]));
  const nameOf = (id: string): string => {
    const node = names.get(id);
    return node ? nodeName(node, lineage) : id;
  };
  return (
    <Card title="Table" note={`${lineage.nodes.length} things, ${lineage.edges.length} links`}>
      <table data-testid="lineage-table">
        <thead>
          <tr>
            <th>From</th>
            <th>To</th>
            <th className="r">Amount</th>
            <th className="wide">How</th>
            <th className="r wide">At</th>
          </tr>
        </thead>
        <tbody>
          {lineage.edges.map((edge, place) => (
            <tr key={place}>
              <td className="b">{nameOf(edge.source)}</td>
              <td className="b">{nameOf(edge.target)}</td>
              <td className="r num">
                {edge.amount_nl === null ? "–" : formatVolume(edge.amount_nl)}
              </td>
              <td className="s wide">
                {(edge.label || names.get(edge.target)?.detail || "").replaceAll("_", " ")}
              </td>
              <td className="r m wide">
                <At at={edge.at} />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Card>
  );
}
