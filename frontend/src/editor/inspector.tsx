/** The selected step: its sentence, its form, and what it compiles to. */

import { Menu } from "@mantine/core";
import { useState } from "react";
import { reorderStep, setNote, setParam } from "@/model/document";
import { fieldOf, findingsOf } from "@/model/findings";
import { formatArguments } from "@/model/format";
import { capitalise } from "@/model/states";
import type { WorkflowStep } from "@/model/wire";
import { plannedDevice } from "@/model/roles";
import { Button, IconButton, TextField } from "@/ui/controls";
import { useVerdict } from "./check";
import { ConnectionsOf } from "./connections";
import { FieldNote } from "./field";
import { fieldsOf, Group, StepField } from "./fields";
import { Sentence, useSentence } from "./node";
import { deleteSelection, duplicateSelection } from "./steps";
import { useDocument, useEditor } from "./store";
import { words } from "./words";

export function Inspector({ onConnect }: { onConnect: () => void }) {
  const document = useDocument();
  const selection = useEditor((state) => state.selection);
  const step = document.steps.find((item) => item.id === selection.at(-1));
  if (!step) {
    return (
      <aside className="insp" aria-label="Step">
        <p className="state-note">{words.editor.nothingSelected}</p>
      </aside>
    );
  }
  const place = document.steps.indexOf(step) + 1;
  return (
    <aside className="insp" aria-label={`Step ${place}`} data-testid="inspector">
      <InspectorHead step={step} place={place} count={selection.length} onConnect={onConnect} />
      <Form step={step} key={step.id} />
      <Compiled step={step} />
    </aside>
  );
}

function InspectorHead(props: {
  step: WorkflowStep;
  place: number;
  count: number;
  onConnect: () => void;
}) {
  const parts = useSentence(props.step);
  const { canEdit, edit } = useEditor.getState();
  const id = props.step.id;
  return (
    <header>
      <div className="ih">
        <span className="chip sq">
          {props.count > 1 ? `${props.count} steps` : `Step ${props.place}`}
        </span>
        <i className="sp" />
        {canEdit && (
          <Menu position="bottom-end" width={200}>
            <Menu.Target>
              <span>
                <IconButton icon="more" label="More" testId="step-menu" />
              </span>
            </Menu.Target>
            <Menu.Dropdown>
              <Menu.Item onClick={props.onConnect} rightSection={<kbd>C</kbd>}>
                Connect to…
              </Menu.Item>
              <Menu.Item onClick={duplicateSelection} rightSection={<kbd>Ctrl D</kbd>}>
                Duplicate
              </Menu.Item>
              <Menu.Item onClick={() => edit(reorderStep(id, -1))}>Move up in the list</Menu.Item>
              <Menu.Item onClick={() => edit(reorderStep(id, 1))}>Move down in the list</Menu.Item>
              <Menu.Divider />
              <Menu.Item onClick={deleteSelection} rightSection={<kbd>Del</kbd>}>
                Delete
              </Menu.Item>
            </Menu.Dropdown>
          </Menu>
        )}
      </div>
      <p className="t14">
        <Sentence parts={parts} />
      </p>
    </header>
  );
}

function Form({ step }: { step: WorkflowStep }) {
  const operation = useEditor((state) => state.palette.get(step.kind));
  const edit = useEditor((state) => state.edit);
  const { findings } = useVerdict();
  if (!operation) {
    return (
      <>
        <p className="state-note">Nothing here can do “{step.kind}”. The step is kept as it is.</p>
        <ConnectionsOf step={step} />
      </>
    );
  }
  const own = findingsOf(findings, step.id);
  const required = new Set(operation.params.required ?? []);
  const fields = fieldsOf(operation.params);
  const render = ([name, schema]: (typeof fields)[number]) => (
    <StepField
      key={name}
      step={step}
      name={name}
      schema={schema}
      isRequired={required.has(name)}
      problems={own.filter((finding) => fieldOf(finding) === name).map((f) => f.message)}
    />
  );
  const isAdvanced = ([, schema]: (typeof fields)[number]): boolean =>
    schema["x-advanced"] === true;
  const names = new Set(fields.map(([name]) => name));
  const others = own.filter((finding) => !names.has(fieldOf(finding) ?? ""));
  const advanced = fields.filter(isAdvanced);
  return (
    <div className="form">
      {others.length > 0 && (
        <div className="field">
          <FieldNote problems={others.map((finding) => finding.message)} />
        </div>
      )}
      {fields.filter((field) => !isAdvanced(field)).map(render)}
      {advanced.length > 0 && <Group title="Advanced">{advanced.map(render)}</Group>}
      <Unknown step={step} known={names} />
      <ConnectionsOf step={step} />
      <TextField
        label="Note"
        value={step.note ?? ""}
        onChange={(note) => edit(setNote(step.id, note))}
        lines={2}
      />
    </div>
  );
}

/** Parameters that this kind of step does not have: they can only be taken away. */
function Unknown({ step, known }: { step: WorkflowStep; known: ReadonlySet<string> }) {
  const { canEdit, edit } = useEditor.getState();
  return Object.entries(step.params)
    .filter(([name]) => !known.has(name))
    .map(([name, value]) => (
      <div key={name} className="field" data-testid="unknown-param">
        <span>
          <b className="mono">{name}</b> means nothing to this step.
        </span>
        <span className="mono m cut">{JSON.stringify(value)}</span>
        {canEdit && (
          <Button onClick={() => edit(setParam(step.id, name, name, undefined))}>
            {words.editor.removeParam}
          </Button>
        )}
      </div>
    ));
}

function Compiled({ step }: { step: WorkflowStep }) {
  const [isOpen, setOpen] = useState(false);
  const { result } = useVerdict();
  const jobs = result?.plan?.jobs.filter((job) => job.step_id === step.id) ?? [];
  if (!jobs.length) return null;
  const shown = isOpen ? jobs : jobs.slice(0, 8);
  return (
    <section className="comp" data-testid="compiled">
      <h3>Compiles to {jobs.length === 1 ? "1 action" : `${jobs.length} actions`}</h3>
      <ol>
        {shown.map((job, place) => (
          <li key={job.index} title={job.sentence}>
            <span className="mono m">{place + 1}</span>
            <span className="cut">{plannedDevice(job)}</span>
            <span className="s num cut">
              {`${capitalise(job.action).toLowerCase()} ${formatArguments(job.args)}`}
            </span>
          </li>
        ))}
      </ol>
      {jobs.length > shown.length && (
        <button type="button" className="btn ghost" onClick={() => setOpen(true)}>
          Show all {jobs.length}
        </button>
      )}
    </section>
  );
}
