/** What an action of a device is called with, drawn from the driver's own schema. */

import { useId, useState, type ReactNode } from "react";
import { setParam } from "@/model/document";
import { parseQuantity, toCanonical } from "@/model/quantity";
import type { ActionForm, Schema, UnitTable } from "@/model/wire";
import { FieldNote, useActions, type FieldProps } from "./field";
import { useEditor } from "./store";

type Values = Record<string, unknown>;

export function ArgumentsField(props: FieldProps & { id: string }) {
  const { step, name } = props;
  const edit = useEditor((state) => state.edit);
  const action = useActions(step).find((a) => a.name === step.params.action);
  const given = step.params[name];
  const values = (typeof given === "object" && given !== null ? given : {}) as Values;
  const set = (key: string, value: unknown): void => {
    const next = { ...values };
    if (value === undefined) Reflect.deleteProperty(next, key);
    else next[key] = value;
    edit(
      setParam(
        step.id,
        name,
        key.replaceAll("_", " "),
        Object.keys(next).length ? next : undefined,
      ),
    );
  };
  const canEdit = useEditor((state) => state.canEdit);
  const units = useEditor((state) => state.units);
  if (!action) return null;
  return (
    <ArgumentsForm action={action} values={values} onChange={set} canEdit={canEdit} units={units}>
      <FieldNote problems={props.problems} />
    </ArgumentsForm>
  );
}

interface FormProps {
  action: ActionForm;
  values: Values;
  onChange: (name: string, value: unknown) => void;
  canEdit: boolean;
  units: Record<string, UnitTable>;
  children?: ReactNode;
}

/** The form of one action, wherever it is shown. */
export function ArgumentsForm({ action, values, onChange, canEdit, units, children }: FormProps) {
  const fields = Object.entries(action.schema.properties ?? {});
  const required = new Set(action.schema.required ?? []);
  return (
    <fieldset className="argsform">
      <legend>{action.doc || action.label}</legend>
      {fields.length === 0 && <p className="help">This action takes no arguments.</p>}
      {fields.map(([key, schema]) => (
        <Argument
          key={`${action.name}.${key}`}
          name={key}
          schema={schema}
          isRequired={required.has(key)}
          value={values[key]}
          onChange={(value) => onChange(key, value)}
          canEdit={canEdit}
          units={units}
        />
      ))}
      {children}
    </fieldset>
  );
}

interface ArgumentProps {
  name: string;
  schema: Schema;
  isRequired: boolean;
  value: unknown;
  onChange: (value: unknown) => void;
  canEdit: boolean;
  units: Record<string, UnitTable>;
}

function typeOf(schema: Schema): string {
  const types = Array.isArray(schema.type) ? schema.type : [schema.type ?? ""];
  return types.find((type) => type !== "null") ?? "";
}

function Argument(props: ArgumentProps) {
  const id = useId();
  const { schema } = props;
  return (
    <div className="field">
      <label htmlFor={id}>
        {schema["x-label"] ?? props.name}
        {!props.isRequired && <span className="opt">optional</span>}
      </label>
      <ArgumentControl {...props} id={id} />
      <p className="help">{[schema.description, range(schema)].filter(Boolean).join(" ")}</p>
    </div>
  );
}

function range({ minimum, maximum, "x-unit": unit = "" }: Schema): string {
  const end = unit && ` ${unit}`;
  if (minimum !== undefined && maximum !== undefined) return `${minimum} to ${maximum}${end}.`;
  if (minimum !== undefined) return `At least ${minimum}${end}.`;
  return maximum !== undefined ? `At most ${maximum}${end}.` : "";
}

function ArgumentControl(props: ArgumentProps & { id: string }) {
  const { schema, value, onChange, id, canEdit } = props;
  const type = typeOf(schema);
  if (schema.enum || type === "boolean") {
    const options = (schema.enum ?? [true, false]).filter((option) => option !== null);
    const shown = value ?? schema.default ?? "";
    return (
      <select
        id={id}
        className="inp"
        disabled={!canEdit}
        value={String(shown)}
        onChange={(event) => onChange(options.find((o) => String(o) === event.target.value))}
      >
        <option value="">–</option>
        {options.map((option) => (
          <option key={String(option)} value={String(option)}>
            {option === true ? "yes" : option === false ? "no" : String(option)}
          </option>
        ))}
      </select>
    );
  }
  if (type === "number" || type === "integer") return <NumberArgument {...props} />;
  if (type === "string") {
    return (
      <input
        id={id}
        className="inp"
        disabled={!canEdit}
        value={typeof value === "string" ? value : ""}
        onChange={(event) => onChange(event.target.value || undefined)}
      />
    );
  }
  return <JsonArgument {...props} />;
}

/** A number in the unit of its name; another unit of the same sort is converted. */
function NumberArgument(props: ArgumentProps & { id: string }) {
  const { schema, value, onChange, id, canEdit, units } = props;
  const [typed, setTyped] = useState<string | null>(null);
  const send = (text: string): void => {
    setTyped(text);
    const bare = Number(text);
    if (!text.trim()) onChange(undefined);
    else if (Number.isFinite(bare)) onChange(bare);
    else if (schema["x-quantity"]) {
      const parsed = parseQuantity(text, schema["x-quantity"], units);
      const number = parsed.ok ? toCanonical(parsed.quantity, schema["x-quantity"]) : null;
      if (number !== null) onChange(number);
    }
  };
  const shown = typeof value === "number" ? String(value) : "";
  const isBad = typed !== null && typed.trim() !== "" && !Number.isFinite(Number(typed)) && !shown;
  return (
    <div className="inp num" aria-invalid={isBad ? true : undefined}>
      <input
        id={id}
        className="bare num"
        inputMode="decimal"
        disabled={!canEdit}
        placeholder={schema.default === undefined ? "" : String(schema.default ?? "")}
        value={typed ?? shown}
        onChange={(event) => send(event.target.value)}
        onBlur={() => setTyped(null)}
      />
      {schema["x-unit"] && <span className="u">{schema["x-unit"]}</span>}
    </div>
  );
}

/** Anything else is written as JSON, so that no driver is ever unusable. */
function JsonArgument({ value, onChange, id }: ArgumentProps & { id: string }) {
  const [typed, setTyped] = useState<string | null>(null);
  const [isBad, setBad] = useState(false);
  const send = (text: string): void => {
    setTyped(text);
    try {
      onChange(text.trim() ? JSON.parse(text) : undefined);
      setBad(false);
    } catch {
      setBad(true);
    }
  };
  return (
    <textarea
      id={id}
      className="inp mono"
      rows={3}
      aria-invalid={isBad ? true : undefined}
      value={typed ?? (value === undefined ? "" : JSON.stringify(value))}
      onChange={(event) => send(event.target.value)}
    />
  );
}
