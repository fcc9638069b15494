/** One request: what will happen, with what, and the decision. */

import { useState } from "react";
import { Link } from "react-router";
import { useResources, useSession } from "@/api/queries";
import { formatDuration, formatMl, formatNumber } from "@/model/format";
import { approvalState } from "@/model/states";
import type { Plan, RunApproval } from "@/model/wire";
import { plannedDevice } from "@/model/roles";
import { Card, Empty } from "@/ui/card";
import { Icon } from "@/ui/icons";
import { FillBar } from "@/ui/number";
import { ProvedPlan } from "@/ui/proved";
import { useSeen } from "@/ui/seen";
import { ModeChip, StateChip } from "@/ui/state";
import { At } from "@/ui/time";
import { Decide } from "./decide";
import { words } from "./words";

type Seen = Record<"actions" | "materials", boolean>;

export function Review({ request }: { request: RunApproval }) {
  const [seen, setSeen] = useState<Seen>({ actions: false, materials: false });
  const mode = useSession().data?.lab?.mode;
  const devices = new Set(request.plan.jobs.map((job) => job.device.id)).size;
  const mark = (part: keyof Seen): void => setSeen((old) => ({ ...old, [part]: true }));
  return (
    <>
      <section className="rev" data-testid="review" data-state={request.state}>
        <header className="rh">
          <Link className="back phone" to="/approvals">
            <Icon name="left" />
            {words.title}
          </Link>
          <h1>{request.title}</h1>
          <div className="risk">
            {mode && <ModeChip mode={mode} />}
            <StateChip state={approvalState(request.state)} />
            <span>
              <Icon name="devices" />
              {devices === 1 ? "1 device moves" : `${devices} devices move`}
            </span>
            <span className="num">
              <Icon name="list" />
              {request.plan.jobs.length} actions
            </span>
            <span className="num">
              <Icon name="time" />≈ {formatDuration(request.plan.estimate_s)}
            </span>
            <Link className="link" to={`/runs/${request.run.id}`}>
              Run #{request.run.number}
            </Link>
            <Link className="link" to={`/workflows/${request.workflow.id}/edit`}>
              {request.workflow.name} v{request.workflow.version}
            </Link>
          </div>
        </header>
        <div className="agent">
          <span className="t12 m">
            {request.asked_by.name} asked at <At at={request.asked_at} />, because
          </span>
          {request.policies.map((policy) => (
            <span key={policy}>{policy}</span>
          ))}
        </div>
        <Steps plan={request.plan} />
        <Actions plan={request.plan} onSeen={() => mark("actions")} />
        <Materials request={request} onSeen={() => mark("materials")} />
      </section>
      <Decide
        request={request}
        parts={[
          { id: "actions", label: "Actions", isSeen: seen.actions },
          { id: "materials", label: "Materials", isSeen: seen.materials },
        ]}
        unsound={null}
      />
    </>
  );
}

function Steps({ plan }: { plan: Plan }) {
  return (
    <Card title="Steps" note="compiled plan">
      <ol className="plansteps">
        {plan.steps.map((step, place) => (
          <li key={step.step_id}>
            <span className="m num">{place + 1}</span>
            <span>{step.sentence}</span>
            <span className="m num">≈ {formatDuration(step.estimate_s)}</span>
          </li>
        ))}
      </ol>
      {plan.notes.map((note) => (
        <p className="help note" key={note}>
          {note}
        </p>
      ))}
      <ProvedPlan plan={plan} />
    </Card>
  );
}

const FEW = 10;

function Actions({ plan, onSeen }: { plan: Plan; onSeen: () => void }) {
  const [isOpen, setOpen] = useState(plan.jobs.length <= FEW);
  const end = useSeen(onSeen);
  const shown = isOpen ? plan.jobs : plan.jobs.slice(0, FEW);
  return (
    <Card
      title="Actions"
      note={`${plan.jobs.length}, in this order`}
      actions={
        isOpen ? null : (
          <button type="button" className="btn ghost t12" onClick={() => setOpen(true)}>
            Show all
          </button>
        )
      }
    >
      <table className="mt" id="review-actions">
        <thead>
          <tr>
            <th className="r">#</th>
            <th>Device</th>
            <th>Does</th>
            <th className="r wide">Takes</th>
          </tr>
        </thead>
        <tbody>
          {shown.map((job) => (
            <tr key={job.index}>
              <td className="r num m">{job.index + 1}</td>
              <td className="b">{plannedDevice(job)}</td>
              <td className="s">{job.sentence}</td>
              <td className="r num m wide">≈ {formatDuration(job.estimate_s)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <div ref={end} />
    </Card>
  );
}

function change(before: number, after: number): string {
  const value = (after - before) / 1_000_000;
  return value > 0 ? `+${formatNumber(value, 2)}` : formatNumber(value, 2);
}

function Materials({ request, onSeen }: { request: RunApproval; onSeen: () => void }) {
  const end = useSeen(onSeen);
  const resources = useResources().data ?? [];
  const capacity = (id: string): number | null =>
    resources.find((row) => row.id === id)?.capacity_nl ?? null;
  return (
    <Card title="Materials" note="all amounts in mL">
      {request.materials.length === 0 && <Empty>No liquid moves.</Empty>}
      {request.materials.length > 0 && (
        <table className="mt" id="review-materials">
          <thead>
            <tr>
              <th>Vessel</th>
              <th className="r">Before</th>
              <th className="r">Change</th>
              <th className="r">After</th>
              <th className="wide" />
              <th className="r">Holds</th>
            </tr>
          </thead>
          <tbody>
            {request.materials.map((row) => {
              const holds = capacity(row.id);
              return (
                <tr key={row.id}>
                  <td className="b">{row.name}</td>
                  <td className="r num">{formatMl(row.before_nl)}</td>
                  <td className="r num s">{change(row.before_nl, row.after_nl)}</td>
                  <td className="r num b">{formatMl(row.after_nl)}</td>
                  <td className="wide">
                    <FillBar share={holds ? Math.min(1, row.after_nl / holds) : null} />
                  </td>
                  <td className="r num m">{holds ? formatMl(holds) : "–"}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
      )}
      <div ref={end} />
    </Card>
  );
}
