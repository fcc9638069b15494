/** From the draft to a run: what will happen, who has to agree, then start. */

import { useMutation } from "@tanstack/react-query";
import { useNavigate } from "react-router";
import { call } from "@/api/client";
import { saveVersion, startRun } from "@/api/commands";
import { useSession } from "@/api/queries";
import { formatDuration } from "@/model/format";
import type { Plan, Version, Workflow } from "@/model/wire";
import { Button, Dialog, Refused } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { ModeChip } from "@/ui/state";
import { useVerdict } from "./check";
import { flushAll } from "./saving";
import { contentOf, useEditor } from "./store";

/** Save a version when the draft differs from the last one, and return the version to run. */
async function versionToRun(): Promise<{ id: string }> {
  const { workflowId, history } = useEditor.getState();
  if (!(await flushAll())) throw new Error("The draft could not be saved, so nothing was started.");
  const workflow = await call<Workflow>("GET", `/workflows/${workflowId}`);
  const latest = workflow.latest_version;
  if (latest) {
    const version = await call<Version>(
      "GET",
      `/workflows/${workflowId}/versions/${latest.number}`,
    );
    if (version.document && contentOf(version.document) === contentOf(history.document))
      return latest;
  }
  return saveVersion(workflowId, "Saved for a run");
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
  const navigate = useNavigate();
  const start = useMutation({
    mutationFn: async () => startRun((await versionToRun()).id),
    onSuccess: (run) => void navigate(`/runs/${run.id}`),
  });
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
      {policies.length > 0 && <Policies policies={policies} />}
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
          why={whyNot(plan, lab?.stop.is_stopped === true)}
          onClick={() => start.mutate()}
        >
          {start.isPending ? "Starting…" : policies.length ? "Request approval" : verb}
        </Button>
      </div>
    </div>
  );
}

function whyNot(plan: Plan | null, isStopped: boolean): string | null {
  if (isStopped) return "The lab is stopped. Reset it first.";
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
  const devices = [...new Set(plan.jobs.map((job) => job.device.name))];
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
