/** What a run waits for: a person who confirms something, states amounts, or acts by hand. */

import { useId, useState } from "react";
import { useConfirmJob } from "@/api/commands";
import { stepNumber } from "@/model/runs";
import type { Job, Run } from "@/model/wire";
import type { LotThere, States } from "@/model/wirerecovery";
import { Button, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { Amount } from "@/ui/number";
import { words } from "./words";

export function AsksPerson({ run, job }: { run: Run; job: Job }) {
  if (!job.asks?.is_due) return null;
  return (
    <section className="card prob" data-state="needs" data-testid="asks-card" data-job={job.id}>
      <div className="ph">
        <Glyph look="needs" />
        {words.asks.title}
        <i className="sp" />
        <span className="num t12">step {stepNumber(run, job.step_id)}</span>
      </div>
      <div className="pb">
        <h2>{job.asks.text}</h2>
        {job.asks.states ? (
          <StateLots run={run} job={job} states={job.asks.states} />
        ) : (
          <Confirm run={run} job={job} />
        )}
      </div>
    </section>
  );
}

function Confirm({ run, job }: { run: Run; job: Job }) {
  const confirm = useConfirmJob(job.id);
  return (
    <>
      <p className="s">{words.asks.about}</p>
      <Refused error={confirm.error} />
      <div className="acts2">
        <Button
          look="pri"
          large
          testId="asks-confirm"
          disabled={confirm.isPending}
          why={run.can.confirm ? null : words.asks.mayNot}
          onClick={() => confirm.mutate(null)}
        >
          {confirm.isPending ? "Sending…" : words.asks.confirm}
        </Button>
      </div>
    </>
  );
}

/** Amounts of the lots in a vessel: an empty field means none of it. */
function StateLots({ run, job, states }: { run: Run; job: Job; states: States }) {
  const confirm = useConfirmJob(job.id);
  const [amounts, setAmounts] = useState<Record<string, string>>({});
  const { lots, leaves_out } = states;
  if (!lots.length && leaves_out) return <p className="s">{words.asks.empty}</p>;
  const typed = lots
    .map((lot): [string, string] => [lot.key, (amounts[lot.key] ?? "").trim()])
    .filter(([, text]) => text);
  const of = (some: readonly [string, string][]) => Object.fromEntries(some);
  const none = leaves_out ? {} : of(lots.map((lot) => [lot.key, "none"]));
  const missing = leaves_out ? words.asks.nothing : words.asks.nothingOfSolids;
  return (
    <>
      <p className="s">
        {leaves_out
          ? words.asks.aboutLots
          : lots.length
            ? words.asks.aboutSolids
            : words.asks.noneThere}
      </p>
      <h3>{states.label}</h3>
      {lots.map((lot) => (
        <LotRow
          key={lot.key}
          lot={lot}
          amount={amounts[lot.key] ?? ""}
          set={(text) => setAmounts({ ...amounts, [lot.key]: text })}
        />
      ))}
      <Refused error={confirm.error} />
      <div className="acts2">
        <Button
          look="pri"
          large
          testId="asks-state"
          disabled={confirm.isPending}
          why={run.can.confirm ? (typed.length ? null : missing) : words.asks.mayNot}
          onClick={() => confirm.mutate({ ...none, ...of(typed) })}
        >
          {confirm.isPending ? "Sending…" : words.asks.state}
        </Button>
        <Button
          large
          testId="asks-none"
          disabled={confirm.isPending}
          why={run.can.confirm ? null : words.asks.mayNot}
          onClick={() => confirm.mutate(none)}
        >
          {leaves_out ? words.asks.none : lots.length ? words.asks.noSolid : words.asks.goOn}
        </Button>
      </div>
    </>
  );
}

function LotRow(props: { lot: LotThere; amount: string; set: (text: string) => void }) {
  const { lot, set } = props;
  const id = useId();
  return (
    <div className="field lotrow" data-testid="asks-lot">
      <label htmlFor={id}>
        {lot.name} <span className="mut t12">{lot.key}</span>
      </label>
      <div className="in">
        <input
          id={id}
          className="inp"
          autoComplete="off"
          aria-describedby={`${id}-help`}
          data-testid={`asks-amount-${lot.key}`}
          value={props.amount}
          onChange={(event) => set(event.target.value)}
        />
        <Button onClick={() => set("all")}>{words.asks.all}</Button>
      </div>
      <p className="help" id={`${id}-help`}>
        <Amount nl={(lot.held_ul ?? 0) * 1000} ug={(lot.held_mg ?? 0) * 1000} /> {words.asks.held}
      </p>
    </div>
  );
}
