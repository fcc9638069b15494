/** The same workflow as a list: for the keyboard, for screen readers, for the phone. */

import { formatDuration } from "@/model/format";
import { findingsOf } from "@/model/findings";
import { reorderStep } from "@/model/document";
import type { WorkflowStep } from "@/model/wire";
import { plannedDevice } from "@/model/roles";
import { IconButton } from "@/ui/controls";
import { useVerdict } from "./check";
import { Sentence, useSentence } from "./node";
import { useDocument, useEditor } from "./store";
import { words } from "./words";

export function ListView() {
  const document = useDocument();
  if (!document.steps.length) return <p className="state-note">{words.editor.emptyCanvas}</p>;
  return (
    <ol className="steps" data-testid="step-list">
      {document.steps.map((step, place) => (
        <Row key={step.id} step={step} place={place} last={document.steps.length - 1} />
      ))}
    </ol>
  );
}

function Row({ step, place, last }: { step: WorkflowStep; place: number; last: number }) {
  const parts = useSentence(step);
  const { result, findings } = useVerdict();
  const isPicked = useEditor((state) => state.selection.includes(step.id));
  const canEdit = useEditor((state) => state.canEdit);
  const select = useEditor((state) => state.select);
  const edit = useEditor((state) => state.edit);
  const label = useEditor((state) => state.palette.get(step.kind)?.label ?? step.kind);
  const own = findingsOf(findings, step.id);
  const planned = result?.plan?.steps.find((item) => item.step_id === step.id);
  const jobs = result?.plan?.jobs.filter((job) => job.step_id === step.id) ?? [];
  const devices = [...new Set(jobs.map(plannedDevice))].join(", ");
  return (
    <li aria-current={isPicked ? "true" : undefined} data-step={step.id}>
      <button type="button" className="stepbtn" onClick={() => select([step.id])}>
        <span className="m num">{place + 1}</span>
        <span className="b">
          <Sentence parts={parts} />
        </span>
        <span className="m num">{planned ? formatDuration(planned.estimate_s) : ""}</span>
        {own[0] ? (
          <span className="help bad">{own[0].message}</span>
        ) : (
          <span className="t12 m">{devices || label}</span>
        )}
      </button>
      {canEdit && (
        <span className="wide rowacts">
          <IconButton
            icon="up"
            label="Move up"
            disabled={place === 0}
            onClick={() => edit(reorderStep(step.id, -1))}
          />
          <IconButton
            icon="down"
            label="Move down"
            disabled={place === last}
            onClick={() => edit(reorderStep(step.id, 1))}
          />
        </span>
      )}
    </li>
  );
}
