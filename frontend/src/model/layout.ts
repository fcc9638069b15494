/** Automatic layout from left to right, or from top to bottom, for workflows and lineage. */

import dagre from "@dagrejs/dagre";

export interface Box {
  id: string;
  width: number;
  height: number;
}

export interface Link {
  source: string;
  target: string;
}

/** Upper left corner of each box. */
export function layoutBoxes(
  boxes: readonly Box[],
  links: readonly Link[],
  gaps: { rank: number; node: number },
  direction: "LR" | "TB" = "LR",
): Map<string, { x: number; y: number }> {
  const graph = new dagre.graphlib.Graph();
  graph.setGraph({
    rankdir: direction,
    ranksep: gaps.rank,
    nodesep: gaps.node,
    marginx: 24,
    marginy: 24,
  });
  graph.setDefaultEdgeLabel(() => ({}));
  const known = new Set(boxes.map((box) => box.id));
  for (const box of boxes) graph.setNode(box.id, { width: box.width, height: box.height });
  for (const link of links) {
    if (known.has(link.source) && known.has(link.target)) graph.setEdge(link.source, link.target);
  }
  dagre.layout(graph);
  return new Map(
    boxes.map((box) => {
      const at = graph.node(box.id) as { x: number; y: number };
      return [
        box.id,
        { x: Math.round(at.x - box.width / 2), y: Math.round(at.y - box.height / 2) },
      ];
    }),
  );
}
