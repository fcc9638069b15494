/** A step on the canvas: its sentence, its ports, what it waits for and what is wrong. */

import { Handle, Position, type NodeProps } from "@xyflow/react";
import { memo, useMemo } from "react";
import { formatDuration } from "@/model/format";
import { findingsOf } from "@/model/findings";
import { whyNotConnect } from "@/model/graph";
import { sentenceOf } from "@/model/sentence";
import type { SentencePart, StepPort, WorkflowStep } from "@/model/wire";
import { plannedDevice } from "@/model/roles";
import { Glyph } from "@/ui/glyph";
import { Icon, iconOf } from "@/ui/icons";
import { useVerdict } from "./check";
import { useEditor } from "./store";

export function Sentence({ parts }: { parts: readonly SentencePart[] }) {
  return (
    <>
      {parts.map((part, place) =>
        part.strong ? (
          part.sort === "quantity" ? (
            <b key={place} className="num">
              {part.text}
            </b>
          ) : (
            <i key={place}>{part.text}</i>
          )
        ) : (
          <span key={place}>{part.text}</span>
        ),
      )}
    </>
  );
}

export function useStep(id: string): WorkflowStep | undefined {
  return useEditor((state) => state.history.document.steps.find((step) => step.id === id));
}

export function useSentence(step: WorkflowStep | undefined): SentencePart[] {
  const palette = useEditor((state) => state.palette);
  const names = useEditor((state) => state.names);
  return useMemo(
    () => (step ? sentenceOf(palette.get(step.kind), step, names) : []),
    [palette, names, step],
  );
}

function StepNode({ id, selected }: NodeProps) {
  const step = useStep(id);
  const parts = useSentence(step);
  const operation = useEditor((state) => state.palette.get(step?.kind ?? ""));
  const { result, findings } = useVerdict();
  if (!step) return null;
  const own = findingsOf(findings, id);
  const jobs = result?.plan?.jobs.filter((job) => job.step_id === id) ?? [];
  const devices = [...new Set(jobs.map(plannedDevice))].join(", ");
  const estimate = result?.plan?.steps.find((planned) => planned.step_id === id)?.estimate_s;
  return (
    <article
      className={`node ${selected ? "sel" : ""}`}
      data-testid={`step-${id}`}
      data-step={id}
      data-state={own.length ? "error" : "ok"}
    >
      <header>
        <Icon name={iconOf(step.kind)} />
        <p>
          <Sentence parts={parts} />
        </p>
      </header>
      <div className="nb cut">{devices || operation?.label}</div>
      <footer>
        {own.length > 0 && (
          <span className="find1">
            <Glyph look="error" />
            {own.length === 1 ? "1 finding" : `${own.length} findings`}
          </span>
        )}
        <i className="sp" />
        {estimate !== undefined && <span className="m num">{formatDuration(estimate)}</span>}
      </footer>
      <Ports step={id} side="in" ports={operation?.inputs ?? []} />
      <Ports step={id} side="out" ports={operation?.outputs ?? []} />
    </article>
  );
}

function Ports(props: { step: string; side: "in" | "out"; ports: StepPort[] }) {
  const upper = props.ports.filter((port) => port.kind !== "done");
  return (
    <>
      {props.ports.map((port) => (
        <PortHandle
          key={port.name}
          step={props.step}
          side={props.side}
          port={port}
          top={port.kind === "done" ? null : 22 + 24 * upper.indexOf(port)}
        />
      ))}
    </>
  );
}

const KIND_WORDS = { done: "order", material: "vessel", data: "value" } as const;

function PortHandle(props: {
  step: string;
  side: "in" | "out";
  port: StepPort;
  top: number | null;
}) {
  const { step, side, port } = props;
  const from = useEditor((state) => state.connectFrom);
  const reason = useEditor((state) =>
    from && side === "in"
      ? whyNotConnect(state.palette, state.history.document, from, { step, port: port.name })
      : null,
  );
  const look = from && side === "in" ? (reason ? "illegal" : "legal") : "";
  return (
    <Handle
      id={port.name}
      type={side === "in" ? "target" : "source"}
      position={side === "in" ? Position.Left : Position.Right}
      className={`port ${side} ${port.kind} ${look}`}
      style={props.top === null ? { top: "auto", bottom: 1 } : { top: props.top }}
      title={reason ?? `${port.label} (${KIND_WORDS[port.kind]})`}
      data-testid={`port-${step}-${side}-${port.name}`}
    />
  );
}

export const MemoStepNode = memo(StepNode);
