/** What users will see of a driver: the form of each action, what it tells, its settings. */

import { useState } from "react";
import { useSteps } from "@/api/queries";
import { ArgumentsForm } from "@/editor/arguments";
import type { DriverInterface } from "@/model/wiredrivers";
import type { DeviceAction, Schema } from "@/model/wire";
import { Empty } from "@/ui/card";
import { words } from "./words";

type About = Pick<DriverInterface, "actions" | "statuses" | "config">;

export function Forms({ about }: { about: About }) {
  const units = useSteps().data?.units ?? {};
  const settings = Object.entries(about.config.properties ?? {});
  return (
    <div className="forms" data-testid="driver-forms">
      {about.actions.length === 0 && <Empty>{words.forms.noActions}</Empty>}
      {about.actions.map((action) => (
        <details key={action.name} data-testid="driver-form-of" data-action={action.name}>
          <summary>
            <span className="b">{action.label}</span>
            <span className="t12 m">{argumentsText(action)}</span>
          </summary>
          <Preview action={action} units={units} />
        </details>
      ))}
      <p className="s">
        <span className="m">{words.forms.statuses} </span>
        {about.statuses.length === 0
          ? words.forms.noStatuses
          : about.statuses.map(({ label, unit }) => `${label}${unit && ` in ${unit}`}`).join(", ")}
      </p>
      {settings.length > 0 && (
        <p className="s">
          <span className="m">{words.forms.settings}: </span>
          {settings.map(([name, schema]) => settingText(name, schema)).join(", ")}
        </p>
      )}
    </div>
  );
}

function Preview(props: {
  action: DeviceAction;
  units: Parameters<typeof ArgumentsForm>[0]["units"];
}) {
  const [values, setValues] = useState<Record<string, unknown>>({});
  return (
    <ArgumentsForm
      action={props.action}
      values={values}
      onChange={(name, value) => setValues((old) => ({ ...old, [name]: value }))}
      canEdit
      units={props.units}
    />
  );
}

function argumentsText(action: DeviceAction): string {
  return Object.entries(action.schema.properties ?? {})
    .map(([name, schema]) => settingText(name, schema))
    .join(" · ");
}

function settingText(name: string, schema: Schema): string {
  const unit = schema["x-unit"] ? ` in ${schema["x-unit"]}` : "";
  return `${schema["x-label"] ?? name}${unit}`;
}
