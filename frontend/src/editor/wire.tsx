/** A wire, drawn from dot to dot and not from the edge of the area one can hit. */

import { BaseEdge, getBezierPath, getSmoothStepPath, type EdgeProps } from "@xyflow/react";

const REACH = 8;
/** Back to the left, a wire goes around the steps it leaves and enters. */
const AROUND = { borderRadius: 24, offset: 28 };

export function Wire(props: EdgeProps) {
  const ends = { ...props, sourceX: props.sourceX - REACH, targetX: props.targetX + REACH };
  const isBackward = ends.targetX < ends.sourceX + 16;
  const [path] = isBackward
    ? getSmoothStepPath({ ...ends, ...AROUND })
    : getBezierPath({ ...ends, curvature: 0.35 });
  return <BaseEdge id={props.id} path={path} interactionWidth={24} />;
}
