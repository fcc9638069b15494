/** What stands in the way of a run, first what is most urgent. */

import { useTopics } from "@/api/live";
import { useDevices } from "@/api/queries";
import {
  findProblems,
  isTakenAway,
  isUnconfirmed,
  pauseText,
  stepNumber,
  type Problem,
} from "@/model/runs";
import { problemText } from "@/model/evidence";
import { formatVolume, sentence } from "@/model/format";
import { jobState } from "@/model/states";
import type { Job, Run } from "@/model/wire";
import { Link } from "react-router";
import { Glyph } from "@/ui/glyph";
import { At } from "@/ui/time";
import { AsksPerson } from "./asks";
import { DoubtCard, Evidence } from "./doubt";
import { Departed } from "./proof";
import { Recovery } from "./recovery";
import { SETPOINT_LOST, words } from "./words";

export function Problems({ run, job }: { run: Run; job: string | null }) {
  const problems = findProblems(run);
  const first = problems.filter((p) => p.kind !== "paused" && p.job.id === job);
  const rest = problems.filter((p) => !first.includes(p));
  return (
    <>
      {run.state === "awaiting_approval" && run.approval && <AwaitsApproval run={run} />}
      {run.waits_for && <WaitsForRun other={run.waits_for} />}
      {run.jobs.map((one) => (
        <AsksPerson key={one.id} run={run} job={one} />
      ))}
      <Departed run={run} />
      <WaitsForDevices run={run} />
      {run.hosts_away.map((host) => (
        <WorksAlone key={host.id} host={host} />
      ))}
      {run.silent.map((one) => (
        <Silent key={one.device.id} one={one} />
      ))}
      {run.contradicted.map((one) => (
        <Contradicted key={one.ticket_id} one={one} />
      ))}
      {[...first, ...rest].map((problem) => (
        <ProblemCard
          key={problem.kind === "paused" ? "paused" : problem.job.id}
          run={run}
          problem={problem}
        />
      ))}
      <Unconfirmed run={run} />
    </>
  );
}

function ProblemCard({ run, problem }: { run: Run; problem: Problem }) {
  if (problem.kind === "doubt") {
    return <DoubtCard run={run} job={problem.job} question={problem.question} />;
  }
  if (problem.kind === "paused") return <PausedCard run={run} />;
  const { job } = problem;
  const undone = isTakenAway(job);
  const halted = job.is_halt_certain ? words.undone.title : words.undone.mayBe;
  const word = job.halted_by === SETPOINT_LOST ? words.undone.lost : halted;
  const state = undone ? { look: "error" as const, word } : jobState(job.state);
  const look = state.look === "stopped" ? "stopped" : "error";
  return (
    <section className="card prob" data-state={look} data-testid="problem-card" data-job={job.id}>
      <div className="ph">
        <Glyph look={look} />
        {state.word}
        <i className="sp" />
        <span className="num t12">
          step {stepNumber(run, job.step_id)}, <At at={job.state_at ?? job.ended_at} seconds />
        </span>
      </div>
      <div className="pb">
        <h2>{undone ? job.sentence : problemText(job) || `${job.sentence} did not complete`}</h2>
        <p className="s" data-testid="problem-effect">
          {undone
            ? words.undone.about(
                job.device.name,
                job.halted_by ?? "",
                job.is_halt_certain,
                job.message,
              )
            : effectText(job)}
        </p>
        {job.recovery && <Recovery run={run} job={job} card={job.recovery} />}
        <Evidence job={job} />
        {job.code && <p className="mono m">{job.code}</p>}
      </div>
    </section>
  );
}

/** What was done and nobody could confirm, as its steps let it be. */
function Unconfirmed({ run }: { run: Run }) {
  const jobs = run.jobs.filter(isUnconfirmed);
  if (jobs.length === 0) return null;
  return (
    <section className="card prob" data-state="needs" data-testid="unconfirmed-card">
      <div className="ph">
        <Glyph look="needs" />
        {words.unconfirmed.title}
      </div>
      <div className="pb">
        <p className="s">{words.unconfirmed.about}</p>
        <ul className="reasons">
          {jobs.map((job) => (
            <li key={job.id}>
              {job.sentence}: {job.message}
            </li>
          ))}
        </ul>
      </div>
    </section>
  );
}

/** A host that cannot be heard goes on by itself, or holds, as the workflow declares. */
function WorksAlone({ host }: { host: Run["hosts_away"][number] }) {
  return (
    <section className="card prob" data-testid="alone-card" data-state="offline">
      <div className="ph">
        <Glyph look="offline" />
        {host.name} works alone since <At at={host.since_at} />
      </div>
      <div className="pb">
        <p className="s">{words.away(host.jobs_count)}</p>
        <Link className="btn" to={`/hosts/${host.id}`}>
          Open {host.name}
        </Link>
      </div>
    </section>
  );
}

/** What stands on a device cannot be read back: nobody knows whether it is kept. */
function Silent({ one: { device, since_at, sentences } }: { one: Run["silent"][number] }) {
  return (
    <section className="card prob" data-testid="silent-card" data-state="offline">
      <div className="ph">
        <Glyph look="offline" />
        <span>
          {device.name} has not been read since <At at={since_at} seconds />
        </span>
      </div>
      <div className="pb">
        <p className="s">{words.silent}</p>
        <ul className="reasons">
          {sentences.map((text) => (
            <li key={text}>{text}</li>
          ))}
        </ul>
        <Link className="btn" to={`/devices/${device.id}`}>
          Open {device.name}
        </Link>
      </div>
    </section>
  );
}

/** A person answered a doubt before its device was read, and that reads otherwise. */
function Contradicted({ one }: { one: Run["contradicted"][number] }) {
  const [title = "", ...rest] = one.text.split(": ");
  return (
    <section className="card prob" data-testid="contradicted-card" data-state="doubt">
      <div className="ph">
        <Glyph look="doubt" />
        <span>{sentence(title)}</span>
      </div>
      <div className="pb">
        <p className="s">{sentence(rest.join(": "))}.</p>
        <Link className="btn" to={`/lab?ticket=${one.ticket_id}`}>
          {words.contradicted}
        </Link>
      </div>
    </section>
  );
}

function WaitsForRun({ other }: { other: NonNullable<Run["waits_for"]> }) {
  return (
    <section className="card prob" data-state="queued" data-testid="waits-run-card">
      <div className="ph">
        <Glyph look="queued" />
        Waits for run #{other.number}
      </div>
      <div className="pb">
        <p className="s">{words.waitsForRun(sentence(other.text))}</p>
        <Link className="btn" to={`/runs/${other.id}`}>
          Open run #{other.number}
        </Link>
      </div>
    </section>
  );
}

/** Work that a host has, for a device that does not answer or has to be halted before. */
function WaitsForDevices({ run }: { run: Run }) {
  const devices = useDevices();
  useTopics("devices");
  const waiting = run.jobs.filter((job) => job.state === "accepted");
  const away = (devices.data ?? []).filter(
    (device) =>
      (device.link !== "online" || device.is_halt_owed) &&
      waiting.some((job) => job.device.id === device.id),
  );
  return away.map((device) => (
    <section key={device.id} className="card prob" data-testid="waits-card" data-state="offline">
      <div className="ph">
        <Glyph look="offline" />
        Waits for {device.name}
      </div>
      <div className="pb">
        <p className="s">{device.is_halt_owed ? words.waitsForHalt : words.waits}</p>
        <Link className="btn" to={`/devices/${device.id}`}>
          Open {device.name}
        </Link>
      </div>
    </section>
  ));
}

function effectText({ transaction: known, recovery, evidence, code }: Job): string {
  const transaction = known?.state ?? null;
  if (code === "device.stopped" && transaction === "rolled_back") return words.halted;
  if (evidence.resolution?.answer === "discard") return words.givenUp;
  if (transaction === "rolled_back")
    return "Nothing moved: the record is as it was before this action.";
  if (transaction === "committed" && recovery?.moved_ul && recovery.asked_ul)
    return `${volume(recovery.moved_ul)} of ${volume(recovery.asked_ul)} moved, by the record.`;
  if (transaction === "committed") return "Part of it happened, and the record says how much.";
  if (transaction === "quarantined") return "What happened is not known yet.";
  return "It never began.";
}

const volume = (ul: number): string => formatVolume(ul * 1000);

function PausedCard({ run }: { run: Run }) {
  const active = run.jobs.filter((job) =>
    ["dispatched", "accepted", "running", "completing"].includes(job.state),
  );
  return (
    <section className="card prob" data-state="paused" data-testid="paused-card">
      <div className="ph">
        <Glyph look="paused" />
        {run.state === "pausing" ? "Pausing" : "Paused"}
      </div>
      <div className="pb">
        {run.state === "pausing" && <p className="s">{words.pausing}</p>}
        {active.map((job) => (
          <p key={job.id} className="s">
            Still under way: {job.device.name}, {job.sentence}
          </p>
        ))}
        <ul className="reasons">
          {run.pause_reasons.map((reason, place) => (
            <li key={place}>
              {pauseText(reason)}
              <i className="sp" />
              <span className="m">
                <At at={reason.at} seconds />
              </span>
            </li>
          ))}
        </ul>
      </div>
    </section>
  );
}

function AwaitsApproval({ run }: { run: Run }) {
  return (
    <section className="card prob" data-state="needs" data-testid="approval-card">
      <div className="ph">
        <Glyph look="needs" />
        Awaits approval
      </div>
      <div className="pb">
        <p className="s">Nothing starts before somebody has decided.</p>
        <Link className="btn" to={`/approvals?id=${run.approval?.id ?? ""}`}>
          Open the request
        </Link>
      </div>
    </section>
  );
}
