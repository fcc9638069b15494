/** What a run waits for: a person who confirms something, or does something by hand. */

import { useConfirmJob } from "@/api/commands";
import { stepNumber } from "@/model/runs";
import type { Job, Run } from "@/model/wire";
import { Button, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { words } from "./words";

export function AsksPerson({ run, job }: { run: Run; job: Job }) {
  const confirm = useConfirmJob(job.id);
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
        <p className="s">{words.asks.about}</p>
        <Refused error={confirm.error} />
        <div className="acts2">
          <Button
            look="pri"
            large
            testId="asks-confirm"
            disabled={confirm.isPending}
            why={run.can.confirm ? null : words.asks.mayNot}
            onClick={() => confirm.mutate(undefined)}
          >
            {confirm.isPending ? "Sending…" : words.asks.confirm}
          </Button>
        </div>
      </div>
    </section>
  );
}
