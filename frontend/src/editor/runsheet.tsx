/** From the draft to a run: what will happen, who has to agree, then start. */

import { useMutation } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useNavigate } from "react-router";
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
      {policies.length > 0 && <Policies policies={policies} />}
      {isConflict && !start.error && (
        <p className="help bad" role="alert">
          {words.editor.conflict} Settle that first.
        </p>
      )}
      <Refused error={start.error} />
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
          onClick={() => plan && start.mutate(plan)}
        >
          {start.isPending ? "Starting…" : policies.length ? "Request approval" : verb}
        </Button>
      </div>
    </div>
  );
}

/** Start by the plan that was seen; when it is another by now, show that one first. */
function useStart() {
  const navigate = useNavigate();
  return useMutation({
    mutationFn: async (seen: Plan) => startRun((await versionToRun()).id, seen.digest),
    onSuccess: (run) => void navigate(`/runs/${run.id}`),
    onError: (error) => {
      if (error instanceof ApiError && error.code === "run.plan_changed") void runCheck();
    },
  });
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
