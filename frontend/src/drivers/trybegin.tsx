/** Where and on what a version is tried, with which settings; and what was tried of it before. */

import { useId, useState } from "react";
import { useSession, useSteps } from "@/api/queries";
import { useBeginTryout } from "@/api/tryouts";
import { ArgumentsForm } from "@/editor/arguments";
import { triedText, tryoutState } from "@/model/tryouts";
import type { DriverDetail } from "@/model/wiredrivers";
import type { ActionForm, Schema } from "@/model/wire";
import type { TryoutHost, Tryouts } from "@/model/wiretryouts";
import { Card, Empty } from "@/ui/card";
import { Button, Refused } from "@/ui/controls";
import { StateText } from "@/ui/state";
import { At } from "@/ui/time";
import { words } from "./words";

type Values = Record<string, unknown>;

interface Props {
  driver: DriverDetail;
  about: Tryouts;
  onBegun: (id: string) => void;
}

export function Begin({ driver, about, onBegun }: Props) {
  const session = useSession().data;
  const begin = useBeginTryout(driver.id);
  const [hostId, setHost] = useState("");
  const [model, setModel] = useState("");
  const [speed, setSpeed] = useState(10);
  const [settings, setSettings] = useState<Values>({});
  const [config, setConfig] = useState<Values>({});
  const host = about.hosts.find((one) => one.id === hostId) ?? about.hosts[0];
  const chosen = host?.models.find((one) => one.model === model);
  const mayBring = session?.user?.lab_permissions.includes("submit") ?? false;
  const why = whyNot(driver, host, Boolean(chosen), mayBring);
  return (
    <Card title={words.trying.begin} note={words.trying.beginNote}>
      <form
        className="sheet padded"
        data-testid="try-form"
        onSubmit={(event) => {
          event.preventDefault();
          if (why || !host) return;
          begin.mutate(
            { host_id: host.id, model, settings, config, speed },
            { onSuccess: (row) => onBegun(row.id) },
          );
        }}
      >
        <Where
          about={about}
          host={host}
          model={model}
          speed={speed}
          onHost={setHost}
          onModel={(value) => {
            setModel(value);
            setSettings({});
          }}
          onSpeed={setSpeed}
        />
        {chosen && (
          <Settings
            title={words.trying.ofInstrument}
            schema={chosen.settings}
            values={settings}
            onChange={setSettings}
            testId="try-settings"
          />
        )}
        <OfDriver driver={driver} values={config} onChange={setConfig} />
        <Start why={why} isPending={begin.isPending} error={begin.error} />
      </form>
    </Card>
  );
}

function OfDriver(props: {
  driver: DriverDetail;
  values: Values;
  onChange: (values: Values) => void;
}) {
  const { config } = props.driver;
  if (Object.keys(config.properties ?? {}).length === 0) return null;
  return (
    <Settings
      title={words.trying.ofDriver}
      schema={config}
      values={props.values}
      onChange={props.onChange}
      testId="try-config"
      isOpen={(config.required ?? []).length > 0}
    />
  );
}

function Start(props: { why: string | null; isPending: boolean; error: Error | null }) {
  return (
    <>
      <Refused error={props.error} />
      {props.why && <p className="help">{props.why}</p>}
      <div className="acts">
        <Button
          type="submit"
          look="pri"
          large
          why={props.why}
          disabled={props.isPending}
          testId="try-begin"
        >
          {words.trying.start}
        </Button>
      </div>
    </>
  );
}

/** Instrument, host and how fast time goes. */
function Where(props: {
  about: Tryouts;
  host: TryoutHost | undefined;
  model: string;
  speed: number;
  onHost: (id: string) => void;
  onModel: (model: string) => void;
  onSpeed: (speed: number) => void;
}) {
  const { about, host } = props;
  return (
    <div className="trywhere">
      <Select
        label={words.trying.instrument}
        value={props.model}
        testId="try-model"
        onChange={props.onModel}
        options={(host?.models ?? []).map((one) => [one.model, `${one.title} · ${one.model}`])}
        empty={words.form.choose}
        help={words.trying.instrumentHelp}
      />
      <Select
        label={words.trying.host}
        value={host?.id ?? ""}
        testId="try-host"
        onChange={props.onHost}
        options={about.hosts.map((one) => [one.id, one.name])}
        help={words.trying.hostHelp}
      />
      <Select
        label={words.trying.speed}
        value={String(props.speed)}
        testId="try-speed"
        onChange={(value) => props.onSpeed(Number(value))}
        options={SPEEDS.filter((one) => one <= about.fastest).map((one) => [
          String(one),
          one === 1 ? words.trying.realTime : `${one}×`,
        ])}
        help={words.trying.speedHelp}
      />
    </div>
  );
}

const SPEEDS = [1, 2, 5, 10, 20, 50, 100];

function whyNot(
  driver: DriverDetail,
  host: TryoutHost | undefined,
  isChosen: boolean,
  mayBring: boolean,
): string | null {
  if (!mayBring) return words.mayNotBring;
  if (driver.state === "rejected" || driver.state === "withdrawn") return words.trying.over;
  if (!host) return words.trying.noHost;
  if (host.problem) return host.problem;
  if (host.models.length === 0) return words.trying.noModel;
  return isChosen ? null : words.trying.choose;
}

function Select(props: {
  label: string;
  value: string;
  options: [value: string, text: string][];
  onChange: (value: string) => void;
  testId: string;
  help: string;
  empty?: string;
}) {
  const id = useId();
  return (
    <div className="field">
      <label htmlFor={id}>{props.label}</label>
      <select
        id={id}
        className="inp"
        value={props.value}
        data-testid={props.testId}
        onChange={(event) => props.onChange(event.target.value)}
      >
        {props.empty && <option value="">{props.empty}</option>}
        {props.options.map(([value, text]) => (
          <option key={value} value={value}>
            {text}
          </option>
        ))}
      </select>
      <p className="help">{props.help}</p>
    </div>
  );
}

/** Settings by the same form as arguments: units, ranges, choices, defaults. */
function Settings(props: {
  title: string;
  schema: Schema;
  values: Values;
  onChange: (values: Values) => void;
  testId: string;
  isOpen?: boolean;
}) {
  const units = useSteps().data?.units ?? {};
  const count = Object.keys(props.schema.properties ?? {}).length;
  const action: ActionForm = {
    name: props.testId,
    label: props.title,
    doc: words.trying.settingsDoc,
    schema: props.schema,
  };
  const set = (name: string, value: unknown): void => {
    const next = { ...props.values };
    if (value === undefined) Reflect.deleteProperty(next, name);
    else next[name] = value;
    props.onChange(next);
  };
  return (
    <div className="forms">
      <details data-testid={props.testId} open={props.isOpen}>
        <summary>
          <span className="b">{props.title}</span>
          <span className="t12 m">
            {Object.keys(props.values).length} of {count} set, the others as by default
          </span>
        </summary>
        <ArgumentsForm action={action} values={props.values} onChange={set} canEdit units={units} />
      </details>
    </div>
  );
}

export function Earlier({ about, onOpen }: { about: Tryouts; onOpen: (id: string) => void }) {
  return (
    <Card title={words.trying.earlier} note={triedText(about.tried)} testId="try-earlier">
      {about.tryouts.length === 0 && <Empty>{words.trying.none}</Empty>}
      <ol className="versionlist">
        {about.tryouts.map((row) => (
          <li key={row.id}>
            <button
              type="button"
              className="tryrow"
              data-testid="try-row"
              onClick={() => onOpen(row.id)}
            >
              <span>{row.title}</span>
              <span className="s">
                <At at={row.begun_at} /> {row.begun_by}
              </span>
              <i className="sp" />
              <StateText state={tryoutState(row)} />
            </button>
          </li>
        ))}
      </ol>
    </Card>
  );
}
