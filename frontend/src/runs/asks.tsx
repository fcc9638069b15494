/** What a run waits for: a person who confirms something, states amounts, or acts by hand. */

import { useId, useState } from "react";
import { useConfirmJob } from "@/api/commands";
import { stepNumber } from "@/model/runs";
import type { Job, Run } from "@/model/wire";
import type { LotThere } from "@/model/wirerecovery";
import { Button, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { Volume } from "@/ui/number";
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
          <StateLots run={run} job={job} lots={job.asks.states.lots} />
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
function StateLots({ run, job, lots }: { run: Run; job: Job; lots: readonly LotThere[] }) {
  const confirm = useConfirmJob(job.id);
  const [amounts, setAmounts] = useState<Record<string, string>>({});
  if (!lots.length) return <p className="s">{words.asks.empty}</p>;
  const label = job.asks?.states?.label ?? "";
  const stated = Object.fromEntries(
    Object.entries(amounts)
      .map(([key, text]): [string, string] => [key, text.trim()])
      .filter(([, text]) => text),
  );
  const none = Object.keys(stated).length ? null : words.asks.nothing;
  return (
    <>
      <p className="s">{words.asks.aboutLots}</p>
      <h3>{label}</h3>
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
          why={run.can.confirm ? none : words.asks.mayNot}
          onClick={() => confirm.mutate(stated)}
        >
          {confirm.isPending ? "Sending…" : words.asks.state}
        </Button>
        <Button
          large
          testId="asks-none"
          disabled={confirm.isPending}
          why={run.can.confirm ? null : words.asks.mayNot}
          onClick={() => confirm.mutate({})}
        >
          {words.asks.none}
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
        <Volume nl={lot.held_ul * 1000} /> {words.asks.held}
      </p>
    </div>
  );
}
