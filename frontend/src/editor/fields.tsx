/** The form of a step, drawn from its schema. */

import { useEffect, useId, useRef, useState, type ReactNode } from "react";
import { amountsOf, amountsText } from "@/model/amounts";
import { setParam } from "@/model/document";
import { formatVolume } from "@/model/format";
import { rolesOf } from "@/model/roles";
import { capitalise } from "@/model/states";
import { isSwitch } from "@/model/sentence";
import { findChoices } from "@/model/tree";
import type { ResourceRow, Schema } from "@/model/wire";
import { Icon, iconOf } from "@/ui/icons";
import { Picker, type Choice } from "@/ui/picker";
import { quantityProblem, QuantityField } from "@/ui/quantityfield";
import { ArgumentsField } from "./arguments";
import { FieldNote, useActions, type FieldProps } from "./field";
import { useEditor } from "./store";

const CALLING = new Set(["device_action", "role_action"]);

export function fieldsOf(schema: Schema): [name: string, field: Schema][] {
  return Object.entries(schema.properties ?? {}).sort(
    ([, a], [, b]) => (a["x-order"] ?? 0) - (b["x-order"] ?? 0),
  );
}

/** One field with its label, help and findings. */
export function StepField(props: FieldProps) {
  const id = useId();
  const { schema, step, name } = props;
  const units = useEditor((state) => state.units);
  const wantsFocus = useEditor((state) => state.focusField === name);
  const box = useRef<HTMLDivElement>(null);
  const value = step.params[name];
  const text = typeof value === "string" ? value : "";
  const isAll = schema["x-all"] === true && text === "all";
  const own =
    schema["x-quantity"] && !isAll ? quantityProblem(text, schema["x-quantity"], units) : null;
  const problems = own ? [own] : props.problems;
  useEffect(() => {
    if (wantsFocus) box.current?.querySelector<HTMLElement>("input, select")?.focus();
  }, [wantsFocus, step.id]);
  if (schema.type === "object" && !schema.additionalProperties)
    return <ArgumentsField {...props} id={id} />;
  if (isSwitch(schema)) return <SwitchField {...props} id={id} />;
  return (
    <div className="field" ref={box} data-field={name}>
      <label htmlFor={id}>
        {schema["x-label"] ?? name}
        {!props.isRequired && <span className="opt">optional</span>}
      </label>
      <Control {...props} id={id} isInvalid={problems.length > 0} />
      <FieldNote problems={problems} help={schema["x-help"]} />
    </div>
  );
}

/** Yes or no: what is not ticked is left out of the document. */
function SwitchField(props: FieldProps & { id: string }) {
  const { schema, step, name, problems } = props;
  const canEdit = useEditor((state) => state.canEdit);
  const send = useSend(props);
  return (
    <div className="field" data-field={name}>
      <label className="check" htmlFor={props.id}>
        <input
          id={props.id}
          type="checkbox"
          data-testid={`field-${name}`}
          disabled={!canEdit}
          aria-invalid={problems.length > 0 ? true : undefined}
          aria-describedby={`${props.id}-note`}
          checked={step.params[name] === true}
          onChange={(event) => send(event.target.checked || undefined)}
        />
        {schema["x-label"] ?? name}
      </label>
      <div id={`${props.id}-note`}>
        <FieldNote problems={problems} help={schema["x-help"]} />
      </div>
    </div>
  );
}

function useSend({ step, name, schema }: FieldProps): (value: unknown) => void {
  const edit = useEditor((state) => state.edit);
  return (value) => edit(setParam(step.id, name, (schema["x-label"] ?? name).toLowerCase(), value));
}

function Control(props: FieldProps & { id: string; isInvalid: boolean }) {
  const { schema, step, name } = props;
  const units = useEditor((state) => state.units);
  const canEdit = useEditor((state) => state.canEdit);
  const send = useSend(props);
  const value = step.params[name];
  const text = typeof value === "string" ? value : "";
  const common = {
    id: props.id,
    isInvalid: props.isInvalid,
    disabled: !canEdit,
    testId: `field-${name}`,
  };
  if (schema["x-quantity"]) {
    return (
      <QuantityField
        {...common}
        key={step.id}
        value={text}
        dimension={schema["x-quantity"]}
        units={units}
        preferredUnit={schema["x-unit"] ?? ""}
        onChange={send}
      />
    );
  }
  if (schema["x-resource"]) return <ResourceField {...props} />;
  if (schema.type === "object") return <AmountsField {...props} />;
  if (CALLING.has(step.kind) && name === "action") return <ActionField {...props} />;
  if (step.kind === "role_action" && name === "role") return <RoleField {...props} />;
  return (
    <input
      id={props.id}
      className="inp"
      data-testid={common.testId}
      disabled={!canEdit}
      aria-invalid={props.isInvalid ? true : undefined}
      maxLength={schema.maxLength}
      value={text}
      onChange={(event) => send(event.target.value || undefined)}
    />
  );
}

/** Amounts by the key of a lot: one on each line, `acid-1: 40 uL`. */
function AmountsField(props: FieldProps & { id: string; isInvalid: boolean }) {
  const { step, name } = props;
  const canEdit = useEditor((state) => state.canEdit);
  const send = useSend(props);
  const [text, setText] = useState(() => amountsText(step.params[name]));
  return (
    <textarea
      id={props.id}
      className="inp"
      rows={3}
      data-testid={`field-${name}`}
      disabled={!canEdit}
      aria-invalid={props.isInvalid ? true : undefined}
      value={text}
      onChange={(event) => {
        setText(event.target.value);
        send(amountsOf(event.target.value));
      }}
    />
  );
}

function amountNote(row: ResourceRow): string {
  if (!row.holds_liquid) return row.kind_label;
  const held = formatVolume(row.volume_nl);
  return row.capacity_nl ? `${held} of ${formatVolume(row.capacity_nl)}` : held;
}

function ResourceField(props: FieldProps & { id: string; isInvalid: boolean }) {
  const { schema, step, name } = props;
  const resources = useEditor((state) => state.resources);
  const canEdit = useEditor((state) => state.canEdit);
  const feeder = useFeeder(step.id, name);
  const send = useSend(props);
  const value = step.params[name];
  const isChosen = (row: ResourceRow): boolean => row.id === value || `@${row.key}` === value;
  const row = resources.find(isChosen);
  const fitting = findChoices(resources, schema["x-resource"] ?? {});
  const rows = row && !fitting.includes(row) ? [row, ...fitting] : fitting;
  const choices = rows.map((item): Choice => ({
    value: item.id,
    label: item.name,
    note: amountNote(item),
  }));
  return (
    <Picker
      id={props.id}
      value={row?.id ?? null}
      choices={choices}
      onChange={(id) => send(id ?? undefined)}
      placeholder={placeholder(value, feeder, props.isRequired)}
      icon={<Icon name={row && !row.holds_liquid ? iconOf(row.kind) : "flask"} />}
      tail={row?.holds_liquid ? formatVolume(row.volume_nl) : null}
      canClear={canEdit && (!props.isRequired || feeder !== null)}
      isInvalid={props.isInvalid}
      disabled={!canEdit}
      testId={`field-${name}`}
    />
  );
}

function placeholder(value: unknown, feeder: string | null, isRequired: boolean): string {
  if (typeof value === "string" && value) return `Not in this lab: ${value}`;
  if (feeder) return `comes from ${feeder}`;
  return isRequired ? "Choose…" : "any";
}

/** The step whose vessel goes on into this field, or null. */
function useFeeder(stepId: string, name: string): string | null {
  return useEditor((state) => {
    const edge = state.history.document.edges.find(
      (e) => e.target === stepId && e.target_port === name,
    );
    if (!edge) return null;
    const place = state.history.document.steps.findIndex((step) => step.id === edge.source);
    return `step ${place + 1}`;
  });
}

function ActionField(props: FieldProps & { id: string; isInvalid: boolean }) {
  const { step } = props;
  const canEdit = useEditor((state) => state.canEdit);
  const actions = useActions(step);
  const send = useSend(props);
  const value = step.params.action;
  const first = step.kind === "role_action" ? "Choose the role first" : "Choose the device first";
  return (
    <Picker
      id={props.id}
      value={typeof value === "string" ? value : null}
      choices={actions.map((a) => ({ value: a.name, label: a.label, note: a.name }))}
      onChange={(name) => send(name ?? undefined)}
      placeholder={actions.length ? "Choose…" : first}
      isInvalid={props.isInvalid}
      disabled={!canEdit}
      testId="field-action"
    />
  );
}

/** A role that some device of the lab plays, with those who do. */
function RoleField(props: FieldProps & { id: string; isInvalid: boolean }) {
  const canEdit = useEditor((state) => state.canEdit);
  const roles = rolesOf(useEditor((state) => state.devices));
  const send = useSend(props);
  const value = props.step.params.role;
  return (
    <Picker
      id={props.id}
      value={typeof value === "string" ? value : null}
      choices={roles.map((one) => ({
        value: one.role,
        label: capitalise(one.label),
        note: one.names.join(", "),
      }))}
      onChange={(role) => send(role ?? undefined)}
      placeholder={roles.length ? "Choose…" : "No device of this lab has a role"}
      isInvalid={props.isInvalid}
      disabled={!canEdit}
      testId="field-role"
    />
  );
}

export function Group({ title, children }: { title: string; children: ReactNode }) {
  return (
    <details className="adv">
      <summary>
        <Icon name="right" size={14} />
        {title}
      </summary>
      <div className="advbody">{children}</div>
    </details>
  );
}
