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
  // Ids are anybody's text, and dagre keeps nodes in plain objects: "constructor" would break it.
  const names = new Map(boxes.map((box, place) => [box.id, `n${place}`]));
  const nameOf = (id: string) => names.get(id) ?? "";
  for (const { id, width, height } of boxes) graph.setNode(nameOf(id), { width, height });
  for (const link of links) {
    const [source, target] = [nameOf(link.source), nameOf(link.target)];
    if (source && target) graph.setEdge(source, target);
  }
  dagre.layout(graph);
  return new Map(
    boxes.map((box) => {
      const at = graph.node(nameOf(box.id)) as { x: number; y: number };
      return [
        box.id,
        { x: Math.round(at.x - box.width / 2), y: Math.round(at.y - box.height / 2) },
      ];
    }),
  );
}
