/** What is done with a driver on trial: its actions, its statuses, faults, the log, the line. */

import { useEffect, useRef, useState } from "react";
import { useSteps } from "@/api/queries";
import { ArgumentsForm } from "@/editor/arguments";
import { acting, EFFECT, faultText, outcomeOf, wireText } from "@/model/tryouts";
import type { DriverDetail } from "@/model/wiredrivers";
import type { ActionForm, DeviceAction } from "@/model/wire";
import type { Tryout, TryoutWish } from "@/model/wiretryouts";
import { Card, Empty } from "@/ui/card";
import { Button } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { ReadingValue } from "@/ui/number";
import { At } from "@/ui/time";
import { words } from "./words";

interface Props {
  tryout: Tryout;
  ask: (wish: TryoutWish) => void;
}
type WithDriver = Props & { driver: DriverDetail };

const whyNot = (tryout: Tryout): string | null =>
  tryout.state === "running"
    ? null
    : tryout.state === "starting"
      ? words.trying.starting
      : words.trying.isOver;

/** The form of each action, as users will see it, and the action itself. */
export function Deeds({ driver, tryout, ask }: WithDriver) {
  const units = useSteps().data?.units ?? {};
  const now = acting(tryout);
  return (
    <Card
      title={words.trying.actions}
      note={words.trying.actionsNote}
      testId="try-actions"
      actions={
        <Button
          testId="try-stop"
          look="danger"
          why={whyNot(tryout) ?? (now ? null : words.trying.nothingActs)}
          onClick={() => ask({ sort: "stop" })}
        >
          {words.trying.stop}
        </Button>
      }
    >
      <div className="forms padded">
        {driver.actions.length === 0 && <Empty>{words.forms.noActions}</Empty>}
        {driver.actions.map((action) => (
          <Deed key={action.name} action={action} tryout={tryout} ask={ask} units={units} />
        ))}
      </div>
    </Card>
  );
}

function Deed(
  props: Props & { action: DeviceAction; units: Parameters<typeof ArgumentsForm>[0]["units"] },
) {
  const { action, tryout, ask } = props;
  const [values, setValues] = useState<Record<string, unknown>>({});
  const now = acting(tryout);
  const isActing = now?.name === action.name;
  const why = whyNot(tryout) ?? (now ? words.trying.acts : null);
  const set = (name: string, value: unknown): void =>
    setValues((old) => {
      const next = { ...old, [name]: value };
      if (value === undefined) Reflect.deleteProperty(next, name);
      return next;
    });
  return (
    <details data-testid="try-action" data-action={action.name} data-acting={isActing}>
      <summary>
        <span className="b">{action.label}</span>
        {isActing && (
          <span className="s ts tone-running">
            <Glyph look="running" /> {words.trying.underWay}
          </span>
        )}
      </summary>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          if (!why) ask({ sort: "act", name: action.name, args: values });
        }}
      >
        <ArgumentsForm action={action} values={values} onChange={set} canEdit units={props.units} />
        <div className="acts padded">
          <Button type="submit" look="pri" why={why} testId="try-do">
            {action.label}
          </Button>
        </div>
      </form>
    </details>
  );
}

/** Every status as it was read last. */
export function Told({ driver, tryout, ask }: WithDriver) {
  const { values = {}, problems = {} } = tryout.statuses;
  return (
    <Card
      title={words.trying.statuses}
      testId="try-statuses"
      actions={
        <Button testId="try-read" why={whyNot(tryout)} onClick={() => ask({ sort: "read" })}>
          {words.trying.read}
        </Button>
      }
    >
      {driver.statuses.length === 0 && <Empty>{words.trying.noStatuses}</Empty>}
      <dl className="trystatuses">
        {driver.statuses.map(({ name, label, unit, doc }) => (
          <div key={name} data-testid="try-status" data-status={name} title={doc}>
            <dt>{label}</dt>
            <dd>
              {name in problems ? (
                <span className="help bad">{problems[name]}</span>
              ) : name in values ? (
                <Value value={values[name]} unit={unit} />
              ) : (
                <span className="m">{words.trying.notRead}</span>
              )}
            </dd>
          </div>
        ))}
      </dl>
    </Card>
  );
}

function Value({ value, unit }: { value: unknown; unit: string }) {
  if (value === null) return <span className="m">{words.trying.nobodyKnows}</span>;
  if (typeof value === "object")
    return <span className="mono t12 long">{JSON.stringify(value)}</span>;
  return <ReadingValue value={value as number | string | boolean} unit={unit} />;
}

/** Faults of the instrument, each to be switched on; all are taken away together. */
export function Faults({ tryout, ask }: Props) {
  const [opened, setOpened] = useState<string | null>(null);
  const names = Object.keys(tryout.faults_offered);
  const why = whyNot(tryout);
  return (
    <Card
      title={words.trying.faults}
      testId="try-faults"
      actions={
        <Button
          testId="try-cure"
          why={why ?? (tryout.faults.length ? null : words.trying.noFault)}
          onClick={() => ask({ sort: "cure" })}
        >
          {words.trying.cure}
        </Button>
      }
    >
      <ul className="tryfaults">
        {names.map((name) => {
          const isOn = tryout.faults.includes(name);
          return (
            <li key={name} data-testid="try-fault" data-fault={name} data-on={isOn}>
              <span className={isOn ? "ts b" : "ts"}>
                {isOn && <Glyph look="needs" />} {faultText(name)}
              </span>
              <Button
                look="ghost"
                why={why}
                onClick={() => setOpened(opened === name ? null : name)}
                aria-expanded={opened === name}
                testId="try-fault-open"
              >
                {isOn ? words.trying.change : words.trying.inflict}
              </Button>
              {opened === name && (
                <Fault
                  key={name}
                  name={name}
                  tryout={tryout}
                  ask={(wish) => {
                    ask(wish);
                    setOpened(null);
                  }}
                />
              )}
            </li>
          );
        })}
      </ul>
    </Card>
  );
}

function Fault({ name, tryout, ask }: Props & { name: string }) {
  const units = useSteps().data?.units ?? {};
  const [values, setValues] = useState<Record<string, unknown>>({});
  const schema = tryout.faults_offered[name] ?? {};
  const action: ActionForm = { name, label: name, doc: words.trying.faultDoc, schema };
  return (
    <form
      className="faultform"
      onSubmit={(event) => {
        event.preventDefault();
        ask({ sort: "fault", name, args: values });
      }}
    >
      <ArgumentsForm
        action={action}
        values={values}
        onChange={(key, value) =>
          setValues((old) => {
            const next = { ...old, [key]: value };
            if (value === undefined) Reflect.deleteProperty(next, key);
            return next;
          })
        }
        canEdit
        units={units}
      />
      <Button type="submit" look="pri" testId="try-fault-on">
        {words.trying.inflict}
      </Button>
    </form>
  );
}

const SORT: Record<string, string> = {
  read: "Read the statuses",
  stop: "Stop",
  cure: "Take the faults away",
  end: "End",
};

/** What was asked and what came of it, the newest first. */
export function Log({ driver, tryout }: { driver: DriverDetail; tryout: Tryout }) {
  const labels = new Map(driver.actions.map((action) => [action.name, action.label]));
  return (
    <Card title={words.trying.log} note={String(tryout.acts.length)} testId="try-log">
      {tryout.acts.length === 0 && <Empty>{words.trying.nothingYet}</Empty>}
      <ol className="trylog">
        {[...tryout.acts].reverse().map((act) => {
          const outcome = outcomeOf(act);
          const name =
            act.sort === "fault" ? `Fault: ${faultText(act.name)}` : labels.get(act.name);
          return (
            <li
              key={act.number}
              data-testid="try-act"
              data-sort={act.sort}
              data-code={act.code}
              data-answered={act.answered_at !== null}
            >
              <span className={`tone-${outcome.look}`}>
                <Glyph look={outcome.look} />
              </span>
              <span className="what">
                <span className="b">{name ?? SORT[act.sort] ?? act.name}</span>
                {Object.keys(act.args).length > 0 && (
                  <span className="t12 m mono">{JSON.stringify(act.args)}</span>
                )}
                <span className={outcome.look === "error" ? "help bad" : "s"}>
                  {act.sort === "act" || outcome.look !== "ok" ? outcome.text : ""}
                </span>
                {act.code && act.effect && (
                  <span className="t12 m">
                    {EFFECT[act.effect]} · <span className="mono">{act.code}</span>
                    {act.has_faults && ` · ${words.trying.withFault}`}
                  </span>
                )}
              </span>
              <span className="t12 m">
                <At at={act.asked_at} seconds />
              </span>
            </li>
          );
        })}
      </ol>
    </Card>
  );
}

/** Every byte that crossed the line, as the tap has it. */
export function Line({ tryout }: { tryout: Tryout }) {
  const box = useRef<HTMLDivElement>(null);
  const last = tryout.wire.at(-1)?.n;
  useEffect(() => {
    if (box.current) box.current.scrollTop = box.current.scrollHeight;
  }, [last]);
  const left = tryout.wire_left_out_count;
  return (
    <Card
      title={words.trying.line}
      note={left ? `${left} ${words.trying.leftOut}` : words.trying.lineNote}
      testId="try-line"
    >
      {tryout.wire.length === 0 && <Empty>{words.trying.silent}</Empty>}
      <div
        className="code trywire"
        ref={box}
        tabIndex={0}
        role="region"
        aria-label={words.trying.line}
      >
        <table>
          <tbody>
            {tryout.wire.map((record) => (
              <tr key={record.n} data-testid="try-record" data-direction={record.direction}>
                <td className="ln">{record.at_s.toFixed(3)}</td>
                <td className="sign">
                  {record.direction === "in" ? words.trying.sent : words.trying.came}
                </td>
                <td title={record.hex}>{wireText(record.hex)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Card>
  );
}
