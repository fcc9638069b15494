/** What every field of a step is given, says below itself and asks of its device. */

import type { Schema, WorkflowStep } from "@/model/wire";
import { useEditor } from "./store";

export interface FieldProps {
  step: WorkflowStep;
  name: string;
  schema: Schema;
  isRequired: boolean;
  /** What the server says about this field. */
  problems: string[];
}

export function FieldNote({ problems, help }: { problems: string[]; help?: string | undefined }) {
  if (problems.length === 0) return <p className="help">{help}</p>;
  return (
    <>
      {problems.map((problem) => (
        <p key={problem} className="help bad" role="alert">
          {problem}
        </p>
      ))}
    </>
  );
}

/** Actions of the device that a step names. */
export function useActions(step: WorkflowStep) {
  const device = useEditor((state) => {
    const row = state.resources.find((r) => r.id === step.params.device);
    return state.devices.find((d) => d.id === row?.device?.id);
  });
  return device?.actions ?? [];
}
