/** What every field of a step is given, says below itself and asks of its device. */

import { actionsOfRole } from "@/model/roles";
import type { DeviceAction, Schema, WorkflowStep } from "@/model/wire";
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

/** Actions of the device that a step names, or of those that play the role it asks for. */
export function useActions(step: WorkflowStep): DeviceAction[] {
  const devices = useEditor((state) => state.devices);
  const resources = useEditor((state) => state.resources);
  const { role, device } = step.params;
  if (typeof role === "string") return actionsOfRole(devices, role);
  const row = resources.find((resource) => resource.id === device);
  return devices.find((one) => one.id === row?.device?.id)?.actions ?? [];
}
