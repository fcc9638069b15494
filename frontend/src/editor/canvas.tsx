/** The canvas: steps as sentences, wires by drag or by click and click. */

import {
  applyNodeChanges,
  Background,
  ReactFlow,
  useReactFlow,
  type Connection,
  type Edge,
  type EdgeChange,
  type FinalConnectionState,
  type Node,
  type NodeChange,
  type OnConnectStartParams,
} from "@xyflow/react";
import { useCallback, useEffect, useMemo, useState, type DragEvent } from "react";
import { connect, moveSteps, removeEdges, portKind } from "@/model/document";
import { whyNotConnect } from "@/model/graph";
import { sentenceOf, sentenceText } from "@/model/sentence";
import type { WorkflowDocument } from "@/model/wire";
import { Icon } from "@/ui/icons";
import { MemoStepNode } from "./node";
import { addFromPalette, DRAG_TYPE, tidy } from "./steps";
import { useDocument, useEditor } from "./store";
import { Wire } from "./wire";
import { words } from "./words";

const nodeTypes = { step: MemoStepNode };
const edgeTypes = { wire: Wire };
const NODE_WIDTH = 212;
const MANY_NODES = 200;

function useNodes(document: WorkflowDocument): [Node[], (changes: NodeChange[]) => void] {
  const selection = useEditor((state) => state.selection);
  const palette = useEditor((state) => state.palette);
  const names = useEditor((state) => state.names);
  const [nodes, setNodes] = useState<Node[]>([]);
  useEffect(() => {
    setNodes((old) => {
      const known = new Map(old.map((node) => [node.id, node]));
      return document.steps.map((step): Node => {
        const sentence = sentenceText(sentenceOf(palette.get(step.kind), step, names));
        return {
          ...known.get(step.id),
          id: step.id,
          type: "step",
          position: step.position,
          data: {},
          width: NODE_WIDTH,
          selected: selection.includes(step.id),
          ariaLabel: sentence,
        };
      });
    });
  }, [document, selection, palette, names]);
  const onChange = useCallback((changes: NodeChange[]) => {
    setNodes((old) => applyNodeChanges(changes, old));
    const picked = changes.filter((change) => change.type === "select");
    if (picked.length) {
      const { selection: before, select } = useEditor.getState();
      const chosen = new Set(before);
      for (const change of picked) {
        if (change.selected) chosen.add(change.id);
        else chosen.delete(change.id);
      }
      select([...chosen]);
    }
  }, []);
  return [nodes, onChange];
}

function useEdges(document: WorkflowDocument): [Edge[], (changes: EdgeChange[]) => void] {
  const palette = useEditor((state) => state.palette);
  const [picked, setPicked] = useState<ReadonlySet<string>>(new Set());
  const edges = useMemo(
    () =>
      document.edges.map((edge): Edge => {
        const kind = portKind(
          palette,
          document,
          { step: edge.source, port: edge.source_port },
          "out",
        );
        return {
          id: edge.id,
          source: edge.source,
          sourceHandle: edge.source_port,
          target: edge.target,
          targetHandle: edge.target_port,
          type: "wire",
          className: `wire ${kind ?? "done"}`,
          selected: picked.has(edge.id),
        };
      }),
    [document, palette, picked],
  );
  const onChange = useCallback((changes: EdgeChange[]) => {
    setPicked((old) => {
      const next = new Set(old);
      for (const change of changes) {
        if (change.type !== "select") continue;
        if (change.selected) next.add(change.id);
        else next.delete(change.id);
      }
      return next;
    });
  }, []);
  return [edges, onChange];
}

function endsOf(link: Connection | Edge): {
  from: { step: string; port: string };
  into: { step: string; port: string };
} {
  return {
    from: { step: link.source, port: link.sourceHandle ?? "" },
    into: { step: link.target, port: link.targetHandle ?? "" },
  };
}

function whyNot(link: Connection | Edge): string | null {
  const { palette, history } = useEditor.getState();
  const { from, into } = endsOf(link);
  return whyNotConnect(palette, history.document, from, into);
}

function onConnect(link: Connection): void {
  const { from, into } = endsOf(link);
  const { edit, set } = useEditor.getState();
  const reason = whyNot(link);
  if (reason) set({ hint: reason });
  else edit(connect(from, into));
}

function startWire(_: unknown, params: OnConnectStartParams): void {
  if (!params.nodeId || !params.handleId || params.handleType !== "source") return;
  useEditor.getState().set({
    connectFrom: { step: params.nodeId, port: params.handleId },
    hint: null,
  });
}

function endWire(_: unknown, end?: FinalConnectionState): void {
  const { connectFrom, set } = useEditor.getState();
  const target = end?.toHandle;
  const reason =
    connectFrom && target && target.type === "target" && target.id
      ? whyNot({
          source: connectFrom.step,
          sourceHandle: connectFrom.port,
          target: target.nodeId,
          targetHandle: target.id,
        })
      : null;
  set({ connectFrom: null, ...(reason ? { hint: reason } : {}) });
}

function allowDrop(event: DragEvent): void {
  if (event.dataTransfer.types.includes(DRAG_TYPE)) event.preventDefault();
}

/** Add a step where it is dropped from the palette. */
function useDrop(): (event: DragEvent) => void {
  const flow = useReactFlow();
  return (event) => {
    const item = event.dataTransfer.getData(DRAG_TYPE);
    if (!item) return;
    event.preventDefault();
    addFromPalette(
      item,
      flow.screenToFlowPosition({ x: event.clientX - 20, y: event.clientY - 20 }),
    );
  };
}

export function Canvas() {
  const document = useDocument();
  const canEdit = useEditor((state) => state.canEdit);
  const [nodes, onNodesChange] = useNodes(document);
  const [edges, onEdgesChange] = useEdges(document);
  const onDrop = useDrop();
  return (
    <section
      className="cv"
      aria-label="Canvas"
      data-testid="canvas"
      onDragOver={allowDrop}
      onDrop={onDrop}
    >
      <ReactFlow
        nodes={nodes}
        edges={edges}
        nodeTypes={nodeTypes}
        edgeTypes={edgeTypes}
        onNodesChange={onNodesChange}
        onEdgesChange={onEdgesChange}
        onEdgesDelete={(gone) => useEditor.getState().edit(removeEdges(gone.map((e) => e.id)))}
        onNodeDragStop={(_, __, moved) =>
          useEditor.getState().edit(moveSteps(new Map(moved.map((n) => [n.id, n.position]))))
        }
        onConnect={onConnect}
        onConnectStart={startWire}
        onConnectEnd={endWire}
        onClickConnectStart={startWire}
        onClickConnectEnd={endWire}
        isValidConnection={(link) => whyNot(link) === null}
        nodesDraggable={canEdit}
        nodesConnectable={canEdit}
        connectOnClick
        edgesFocusable={false}
        deleteKeyCode={null}
        selectionOnDrag
        panOnScroll
        panOnDrag={[1, 2]}
        minZoom={0.2}
        maxZoom={2}
        fitView
        fitViewOptions={{ maxZoom: 1, padding: 0.08, minZoom: 0.5 }}
        onlyRenderVisibleElements={document.steps.length > MANY_NODES}
        attributionPosition="bottom-left"
      >
        <Background gap={16} size={1.2} color="var(--line-2)" bgColor="var(--sunken)" />
      </ReactFlow>
      {document.steps.length === 0 && <p className="ghost s">{words.editor.emptyCanvas}</p>}
      <ConnectHint />
      <Zoom />
      <DeleteEdgeKey edges={edges} />
    </section>
  );
}

/** Delete removes the picked wires when no step is picked. */
function DeleteEdgeKey({ edges }: { edges: Edge[] }) {
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      if (event.key !== "Delete" && event.key !== "Backspace") return;
      if ((event.target as HTMLElement).closest("input, textarea, select, [role=dialog]")) return;
      const picked = edges.filter((edge) => edge.selected).map((edge) => edge.id);
      // A box around steps picks their wires, too: deleting the steps looks after those.
      if (event.defaultPrevented || useEditor.getState().selection.length) return;
      if (picked.length) useEditor.getState().edit(removeEdges(picked));
    };
    window.addEventListener("keydown", onKey);
    return () => window.removeEventListener("keydown", onKey);
  }, [edges]);
  return null;
}

function ConnectHint() {
  const hint = useEditor((state) => state.hint);
  const from = useEditor((state) => state.connectFrom);
  if (hint) {
    return (
      <p className="cvhint help bad" role="alert" data-testid="connect-reason">
        {hint}
      </p>
    );
  }
  if (!from) return null;
  return (
    <p className="cvhint t12 s" role="status">
      Click the port it goes to, or press Esc.
    </p>
  );
}

function Zoom() {
  const flow = useReactFlow();
  const canEdit = useEditor((state) => state.canEdit);
  return (
    <div className="zoom">
      <button
        type="button"
        className="ib"
        aria-label="Zoom out"
        onClick={() => void flow.zoomOut()}
      >
        <Icon name="minus" />
      </button>
      <button type="button" className="ib" aria-label="Zoom in" onClick={() => void flow.zoomIn()}>
        <Icon name="plus" />
      </button>
      <button
        type="button"
        className="ib"
        aria-label="Fit"
        title="Fit (F)"
        onClick={() => void flow.fitView({ maxZoom: 1, padding: 0.08 })}
      >
        <Icon name="fit" />
      </button>
      {canEdit && (
        <button
          type="button"
          className="ib"
          aria-label="Tidy"
          title="Tidy (Shift T)"
          onClick={() => tidy()}
        >
          <Icon name="tidy" />
        </button>
      )}
    </div>
  );
}
