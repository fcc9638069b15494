/** Head of a run: what it is, how it stands, what one may do. */

import { useState } from "react";
import { Link } from "react-router";
import { useRunAct } from "@/api/commands";
import { useStatus } from "@/api/connection";
import { useKept } from "@/api/kept";
import { runOutcome } from "@/model/decisions";
import { missingText } from "@/model/files";
import { formatDuration, toSeconds } from "@/model/format";
import { executionText } from "@/model/hosts";
import {
  currentStep,
  findProblems,
  isHeldByProof,
  isUnconfirmed,
  pausesSeen,
  stepNumber,
  type StepProgress,
} from "@/model/runs";
import type { Run } from "@/model/wire";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { Downloads } from "@/ui/downloads";
import { Icon } from "@/ui/icons";
import { ProvedChip } from "@/ui/proved";
import { ModeChip, StateChip } from "@/ui/state";
import { At, useLabTime, useNow } from "@/ui/time";
import { words } from "./words";

export function RunHead({ run }: { run: Run }) {
  const doubts = run.jobs.filter((job) => job.state === "in_doubt").length;
  const unconfirmed = run.jobs.filter(isUnconfirmed).length;
  return (
    <div className="h1">
      <h1>
        <span className="num">Run #{run.number}</span>
      </h1>
      <Link to={`/workflows/${run.workflow.id}/edit`} className="t14 wflink">
        {run.workflow.name} <span className="m">v{run.workflow.version}</span>
      </Link>
      <ModeChip mode={run.mode} />
      <span data-testid="run-state" data-state={run.state}>
        <StateChip state={runOutcome(run)} />
      </span>
      <ProvedChip plan={run.plan} />
      {doubts > 0 && <StateChip state={{ look: "doubt", word: `${doubts} in doubt` }} />}
      {unconfirmed > 0 && (
        <span data-testid="run-unconfirmed">
          <StateChip state={{ look: "needs", word: `${unconfirmed} unconfirmed` }} />
        </span>
      )}
      <i className="sp" />
      <span className="s t12 wide nw">
        {run.started_at ? "Started" : "Made"} <At at={run.started_at ?? run.created_at} /> by{" "}
        {run.created_by}
      </span>
      <Acts run={run} />
    </div>
  );
}

function Acts({ run }: { run: Run }) {
  const act = useRunAct(run.id);
  const abort = useRunAct(run.id);
  const [isAborting, setAborting] = useState(false);
  const isOver = run.state === "complete" || run.state === "aborted";
  const offline = useStatus() === "offline" ? "Not connected." : null;
  if (isOver) return <Exports run={run} />;
  if (run.is_given_up) return <Aborting />;
  const isPaused = run.pause_reasons.length > 0 || run.can.resume || run.state === "paused";
  const mayResume = run.can.resume && !isHeldByProof(run);
  // Who closed the dialog before the answer came is told here.
  const error = act.error ?? (isAborting ? null : abort.error);
  return (
    <>
      {error && (
        <span className="t12 err" role="alert">
          {error.message}
        </span>
      )}
      {isPaused && !mayResume && <span className="t12 m wide">{whyNotResume(run)}</span>}
      <span className="acts runacts">
        {isPaused && (
          <Button
            large
            testId="resume"
            disabled={act.isPending}
            why={offline ?? (mayResume ? null : whyNotResume(run))}
            onClick={() => act.mutate({ act: "resume", pauses: pausesSeen(run) })}
          >
            <Icon name="runs" />
            {words.resume}
          </Button>
        )}
        {(!isPaused || run.can.pause) && (
          <Button
            large
            testId="pause"
            disabled={act.isPending}
            why={offline ?? (run.can.pause ? null : words.notNow)}
            onClick={() => act.mutate({ act: "pause" })}
          >
            <Icon name="pause" />
            {isPaused ? words.alsoPause : act.isPending ? "Sending…" : words.pause}
          </Button>
        )}
        <Button
          large
          look="danger"
          testId="abort"
          why={offline ?? (run.can.abort ? null : words.notNow)}
          onClick={() => setAborting(true)}
        >
          {words.abort}
        </Button>
      </span>
      <AbortDialog run={run} act={abort} isOpen={isAborting} onClose={() => setAborting(false)} />
    </>
  );
}

function Aborting() {
  return (
    <span className="t12 s" role="status" data-testid="aborting">
      {words.aborting}
    </span>
  );
}

/** Everything about the run in one file, for an archive or a notebook. */
function Exports({ run }: { run: Run }) {
  const { crate, eln } = words.exports;
  return (
    <Downloads
      files={[
        { ...crate, path: `runs/${run.id}/crate`, name: `run-${run.number}.crate.zip` },
        { ...eln, path: `runs/${run.id}/eln`, name: `run-${run.number}.eln` },
      ]}
    />
  );
}

function whyNotResume(run: Run): string {
  if (run.in_doubt_count > 0) return words.answerFirst;
  if (run.can.resume && isHeldByProof(run)) return words.proof.resume;
  const hasFailed = findProblems(run).some((problem) => problem.kind === "failed");
  return hasFailed ? words.cannotGoOn : words.notNow;
}

function UnderWay({ jobs }: { jobs: Run["jobs"] }) {
  const active = jobs.filter((job) =>
    ["dispatched", "accepted", "running", "completing"].includes(job.state),
  );
  if (active.length === 0) return null;
  return (
    <div>
      <p className="b">Under way now</p>
      <ul>
        {active.map((job) => (
          <li key={job.id} className="s">
            {job.device.name}: {job.sentence}
          </li>
        ))}
      </ul>
    </div>
  );
}

interface Aborting {
  run: Run;
  act: ReturnType<typeof useRunAct>;
  isOpen: boolean;
  onClose: () => void;
}

function AbortDialog({ act, ...props }: Aborting) {
  const [reason, setReason, forget] = useKept(`abort/${props.run.id}`, "");
  const send = (): void =>
    act.mutate(
      { act: "abort", reason: reason.trim() },
      {
        onSuccess: () => {
          forget();
          props.onClose();
        },
      },
    );
  return (
    <Dialog title={words.abortTitle} isOpen={props.isOpen} onClose={props.onClose}>
      <form
        className="sheet"
        onSubmit={(event) => {
          event.preventDefault();
          send();
        }}
      >
        <p className="s">{words.abortAbout}</p>
        <UnderWay jobs={props.run.jobs} />
        {props.run.in_doubt_count > 0 && <p className="s">{words.abortDoubt}</p>}
        <TextField
          label={words.abortWhy}
          value={reason}
          onChange={setReason}
          lines={2}
          autoFocus
          testId="abort-reason"
        />
        <Refused error={act.error} />
        <div className="acts">
          <Button large onClick={props.onClose}>
            Go on with the run
          </Button>
          <Button
            large
            look="danger"
            type="submit"
            testId="abort-confirm"
            disabled={act.isPending}
            why={reason.trim() ? null : "Write the reason first."}
          >
            {act.isPending ? "Sending…" : words.abortDo}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}

export function Facts({ run, steps }: { run: Run; steps: StepProgress[] }) {
  const now = useNow();
  const time = useLabTime();
  const current = currentStep(steps);
  const started = toSeconds(run.started_at);
  const ended = toSeconds(run.ended_at);
  const isOver = ended !== null;
  const elapsed = started === null ? null : (ended ?? now) - started;
  const left = run.state === "paused" ? null : run.left_s;
  const missing = missingText(run.files);
  return (
    <dl className="facts">
      <div>
        <dt>
          {current && !isOver
            ? `Step ${current.number} of ${steps.length}`
            : `${run.steps_done} of ${run.steps_total} steps done`}
        </dt>
        <dd>{isOver ? runOutcome(run).word : (current?.step.sentence ?? "–")}</dd>
      </div>
      <div>
        <dt>Elapsed</dt>
        <dd>{elapsed === null ? "–" : formatDuration(elapsed)}</dd>
      </div>
      <div>
        <dt>{isOver ? "Planned" : "Left, by the plan"}</dt>
        <dd>
          {isOver
            ? formatDuration(run.estimate_s)
            : left === null
              ? "–"
              : `≈ ${formatDuration(left)}`}
        </dd>
      </div>
      <div>
        <dt>{isOver ? "Ended" : "Ends"}</dt>
        <dd>
          {isOver ? time.minute(ended) : left === null ? "–" : `≈ ${time.minute(now + left)}`}
        </dd>
      </div>
      <div className="wide">
        <dt>Server away</dt>
        <dd data-testid="run-execution">{executionText(run.execution)}</dd>
      </div>
      {missing && (
        <div className="missing">
          <dt>{words.measured.missing}</dt>
          <dd className="tone-error" data-testid="files-missing">
            {missing}
          </dd>
        </div>
      )}
      <div className="wide">
        <dt>Needs you</dt>
        <dd>{needText(run)}</dd>
      </div>
    </dl>
  );
}

function needText(run: Run): string {
  const first = findProblems(run)[0];
  if (first?.kind === "doubt" && run.ended_at) {
    return `resolve step ${stepNumber(run, first.job.step_id)} now`;
  }
  if (run.ended_at || run.is_given_up) return "nothing";
  if (run.state === "awaiting_approval") return "approve the start";
  if (first?.kind === "doubt") return `resolve step ${stepNumber(run, first.job.step_id)} now`;
  if (first?.kind === "failed") return "decide how the run goes on";
  if (run.state === "paused") return "resume";
  const asked = run.jobs.find((job) => job.asks?.is_due);
  if (asked) return `answer at step ${stepNumber(run, asked.step_id)} now`;
  return "not foreseen";
}
