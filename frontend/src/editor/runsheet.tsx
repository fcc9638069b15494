/** From the draft to a run: what will happen, who has to agree, then start. */

import { useEffect, useState } from "react";
import { useNavigate } from "react-router";
import { useAct } from "@/api/act";
import { ApiError } from "@/api/client";
import { startRun } from "@/api/commands";
import { useSession } from "@/api/queries";
import { fetchVersion, fetchWorkflow } from "@/api/workflows";
import { formatDuration } from "@/model/format";
import type { Plan } from "@/model/wire";
import { plannedDevice } from "@/model/roles";
import { Button, Dialog, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { ModeChip } from "@/ui/state";
import { ProvedPlan } from "@/ui/proved";
import { runCheck, useVerdict } from "./check";
import { ProofOnSheet } from "./proof";
import { flushOrThrow, hearOf, saveSeen } from "./saving";
import { contentOf, useEditor } from "./store";
import { words } from "./words";

/** Save a version when the page differs from the last one, and return the version to run. */
async function versionToRun(): Promise<{ id: string }> {
  await flushOrThrow();
  const { workflowId, history, saving } = useEditor.getState();
  const workflow = await fetchWorkflow(workflowId);
  if (workflow.draft_revision !== saving.revision) {
    hearOf(workflow);
    throw new Error(words.editor.conflict);
  }
  const latest = workflow.latest_version;
  if (latest) {
    const version = await fetchVersion(workflowId, latest.number);
    if (version.document && contentOf(version.document) === contentOf(history.document))
      return latest;
  }
  return saveSeen("Saved for a run");
}

export function RunSheet({ isOpen, onClose }: { isOpen: boolean; onClose: () => void }) {
  return (
    <Dialog title="Start a run" isOpen={isOpen} onClose={onClose} size={480} testId="run-sheet">
      <Sheet onClose={onClose} />
    </Dialog>
  );
}

function Sheet({ onClose }: { onClose: () => void }) {
  const { result, findings } = useVerdict();
  const lab = useSession().data?.lab;
  const isFresh = useFreshCheck();
  const isConflict = useEditor((state) => state.saving.conflict !== null);
  const start = useStart();
  const plan = result?.plan ?? null;
  const policies = result?.policies ?? [];
  const verb = lab?.mode === "live" ? "Start live" : "Start in simulation";
  return (
    <div className="sheet">
      {lab && (
        <p className="mode">
          <ModeChip mode={lab.mode} />
          {lab.mode === "live"
            ? "Real devices will move."
            : "Simulated instruments; nothing real moves."}
        </p>
      )}
      {!result && <p className="m">Checking…</p>}
      {result && !plan && (
        <div role="alert">
          <p className="b">This cannot run yet.</p>
          {findings.map((finding, place) => (
            <p className="help bad" key={place}>
              {finding.message}
            </p>
          ))}
        </div>
      )}
      {plan && <Summary plan={plan} />}
      {result?.proof && <ProofOnSheet proof={result.proof} />}
      {plan && <ProvedPlan plan={plan} />}
      {policies.length > 0 && <Policies policies={policies} />}
      {isConflict && !start.error && (
        <p className="help bad" role="alert">
          {words.editor.conflict} Settle that first.
        </p>
      )}
      <Refused error={waitingRuns(start.error) ? null : start.error} />
      <div className="acts">
        <Button large onClick={onClose}>
          Cancel
        </Button>
        <Button
          large
          look="pri"
          testId="start-run"
          disabled={start.isPending}
          why={whyNot(plan, { isStopped: lab?.stop.is_stopped === true, isConflict, isFresh })}
          onClick={() => plan && start.mutate({ seen: plan, isSecond: false })}
        >
          {start.isPending ? "Starting…" : policies.length ? "Request approval" : verb}
        </Button>
      </div>
      <SecondRun start={start} plan={plan} />
    </div>
  );
}

/** Start by the plan that was seen; when it is another by now, show that one first. */
function useStart() {
  const navigate = useNavigate();
  return useAct({
    mutationFn: async ({ seen, isSecond }: { seen: Plan; isSecond: boolean }) =>
      startRun((await versionToRun()).id, seen.digest, isSecond),
    onSuccess: (run) => void navigate(`/runs/${run.id}`),
    onError: (error) => {
      if (error instanceof ApiError && error.code === "run.plan_changed") void runCheck();
    },
  });
}

interface WaitingRun {
  id: string;
  number: number;
}

/** The runs of the version that have not begun, when a start was refused for them. */
function waitingRuns(error: Error | null): WaitingRun[] | null {
  if (!(error instanceof ApiError) || error.code !== "run.already_waiting") return null;
  return error.refusal.context["runs"] as WaitingRun[];
}

/** Ask whether a second run is wanted while the first has not begun. */
function SecondRun({ start, plan }: { start: ReturnType<typeof useStart>; plan: Plan | null }) {
  const navigate = useNavigate();
  const runs = waitingRuns(start.error);
  const numbers = runs?.map((run) => `#${run.number}`).join(", ");
  const first = runs?.[0];
  return (
    <Dialog
      title="Start a second run?"
      isOpen={runs !== null}
      onClose={start.reset}
      testId="second-run"
    >
      <div className="sheet">
        <p className="s">
          {numbers
            ? `Run ${numbers} of this version has not begun yet.`
            : "A run of this version that you may not see has not begun yet."}{" "}
          A second run does every step once more and uses the same amounts again.
        </p>
        <div className="acts">
          <Button large onClick={start.reset}>
            Cancel
          </Button>
          {first && (
            <Button large testId="show-first" onClick={() => void navigate(`/runs/${first.id}`)}>
              Show run #{first.number}
            </Button>
          )}
          <Button
            large
            look="pri"
            testId="start-second"
            disabled={start.isPending}
            onClick={() => plan && start.mutate({ seen: plan, isSecond: true })}
          >
            Start a second run
          </Button>
        </div>
      </div>
    </Dialog>
  );
}

/** Check again as the sheet opens: the lab may have changed since one drew. */
function useFreshCheck(): boolean {
  const [isFresh, setFresh] = useState(false);
  useEffect(() => {
    const abort = new AbortController();
    void runCheck(abort.signal).then(() => {
      if (!abort.signal.aborted) setFresh(true);
    });
    return () => abort.abort();
  }, []);
  return isFresh;
}

interface Obstacles {
  isStopped: boolean;
  isConflict: boolean;
  isFresh: boolean;
}

function whyNot(plan: Plan | null, { isStopped, isConflict, isFresh }: Obstacles): string | null {
  if (isStopped) return "The lab is stopped. Reset it first.";
  if (isConflict) return `${words.editor.conflict} Settle that first.`;
  if (!isFresh) return words.editor.checking;
  return plan ? null : "The findings have to be settled first.";
}

function Policies({ policies }: { policies: string[] }) {
  return (
    <ul className="policies" data-testid="policies">
      {policies.map((policy) => (
        <li key={policy}>
          <span className="tone-needs">
            <Glyph look="needs" />
          </span>
          {policy}
        </li>
      ))}
    </ul>
  );
}

function Summary({ plan }: { plan: Plan }) {
  const devices = [...new Set(plan.jobs.map(plannedDevice))];
  return (
    <>
      <dl className="kv" data-testid="plan-summary">
        <dt>Steps</dt>
        <dd>{plan.steps.length}</dd>
        <dt>Actions</dt>
        <dd>{plan.jobs.length}</dd>
        <dt>Devices</dt>
        <dd>
          {devices.length}: {devices.join(", ")}
        </dd>
        <dt>Time</dt>
        <dd>≈ {formatDuration(plan.estimate_s)}</dd>
      </dl>
      {plan.notes.map((note) => (
        <p className="help" key={note}>
          {note}
        </p>
      ))}
    </>
  );
}
