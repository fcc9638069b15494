/** One run: identity and state, five facts, then what happens, and what is wrong. */

import "./run.css";
import { lazy, Suspense, useMemo } from "react";
import { Link, useParams, useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { useRun, useRunEvents } from "@/api/queries";
import { findProblems, isTakenAway, stepProgress, type StepProgress } from "@/model/runs";
import type { Job, Run } from "@/model/wire";
import { AsOf, Card, Empty, Loaded } from "@/ui/card";
import { EventTable } from "@/ui/events";
import { countOf, More } from "@/ui/more";
import { TwinChip, TwinFrame } from "@/twin/frame";
import { Icon } from "@/ui/icons";
import { PageState } from "@/ui/pagestate";
import { Decisions } from "./decisions";
import { RunFiles } from "./files";
import { Halts } from "./halts";
import { Facts, RunHead } from "./head";
import { JobFacts } from "./job";
import { RunLog } from "./log";
import { Holds } from "./holds";
import { Problems } from "./problem";
import { RunReportTab } from "./report";
import { StepStrip } from "./strip";
import { RunTelemetry } from "./telemetry";
import { Timeline } from "./gantt";
import { words } from "./words";

const RunCanvas = lazy(async () => ({ default: (await import("./canvastab")).RunCanvas }));

const TABS = ["timeline", "canvas", "logs", "telemetry", "events", "report"] as const;
type Tab = (typeof TABS)[number];

export function RunPage() {
  const { id = "" } = useParams();
  const run = useRun(id);
  useTopics(`run:${id}`, "events");
  if (!run.data) {
    return <PageState of="run" error={run.error} retry={run.refetch} />;
  }
  return (
    <>
      {run.error && <AsOf at={run.dataUpdatedAt} why={run.error.message} />}
      <Body run={run.data} key={id} />
    </>
  );
}

function useSelection(): {
  tab: Tab;
  job: string | null;
  pick: (job: string | null) => void;
  link: (tab: Tab) => string;
} {
  const [params, setParams] = useSearchParams();
  const asked = params.get("tab") as Tab;
  const tab = TABS.includes(asked) ? asked : "timeline";
  const job = params.get("job");
  const query = (next: Tab, nextJob: string | null): string => {
    const parts = new URLSearchParams();
    if (next !== "timeline") parts.set("tab", next);
    if (nextJob) parts.set("job", nextJob);
    return parts.size ? `?${parts.toString()}` : "";
  };
  return {
    tab,
    job,
    pick: (next) => setParams(query(tab, next === job ? null : next), { replace: true }),
    link: (next) => query(next, job) || ".",
  };
}

/** A tab that stands beside a narrow screen comes into it. */
const intoView = (node: HTMLElement | null): void => {
  const row = node?.parentElement;
  if (!node || !row) return;
  row.scrollLeft = Math.min(row.scrollLeft, node.offsetLeft - row.offsetLeft);
  const over = node.offsetLeft - row.offsetLeft + node.offsetWidth - row.clientWidth;
  row.scrollLeft = Math.max(row.scrollLeft, over);
};

function Body({ run }: { run: Run }) {
  const { tab, job, pick, link } = useSelection();
  const steps = useMemo(() => stepProgress(run), [run]);
  const events = useRunEvents(run.id);
  const isUrgent = run.is_given_up || findProblems(run).some((one) => one.kind !== "paused");
  return (
    <div className="run" data-testid="run" data-state={run.state} data-mode={run.mode}>
      <header className="head" data-mode={run.mode}>
        <RunHead run={run} />
        <Facts run={run} steps={steps} />
        <nav className="tabs" aria-label="Parts of the run">
          {TABS.map((name) => (
            <Link
              key={name}
              ref={tab === name ? intoView : undefined}
              to={link(name)}
              replace
              aria-current={tab === name ? "page" : undefined}
              data-testid={`tab-${name}`}
            >
              {words.tabs[name]}
              {name === "events" && events.data && <span className="m num">{countOf(events)}</span>}
            </Link>
          ))}
        </nav>
      </header>
      <div className="body">
        <div className="col">
          <Main run={run} steps={steps} tab={tab} job={job} pick={pick} link={link} />
        </div>
        <aside className={`col aside ${isUrgent ? "urgent" : ""}`}>
          <Card
            title="Twin"
            note={<TwinChip />}
            className="twincard"
            actions={
              <Link className="ib" to="/twin" aria-label="Open the twin" title="Open the twin">
                <Icon name="fit" />
              </Link>
            }
          >
            <TwinFrame title={`Twin of run ${run.number}`} />
          </Card>
          <div className="col problems">
            <Halts run={run} />
            <Problems run={run} job={job} />
          </div>
          {job && <JobCard run={run} job={job} />}
          <Holds run={run} />
          <Decisions run={run} />
        </aside>
      </div>
    </div>
  );
}

function Main(props: {
  run: Run;
  steps: StepProgress[];
  tab: Tab;
  job: string | null;
  pick: (job: string | null) => void;
  link: (tab: Tab) => string;
}) {
  const { run, steps, tab, job, pick } = props;
  const picked = run.jobs.find((item) => item.id === job)?.step_id ?? null;
  const pickStep = (stepId: string): void => {
    const jobs = run.jobs.filter((item) => item.step_id === stepId);
    const wanted =
      jobs.find((item) => item.state === "in_doubt") ??
      jobs.find((item) => item.state === "running") ??
      jobs[0];
    if (wanted) pick(wanted.id);
  };
  if (tab === "canvas") {
    return (
      <Suspense fallback={<p className="m">Loading the canvas…</p>}>
        <RunCanvas run={run} steps={steps} />
      </Suspense>
    );
  }
  if (tab === "logs") return <RunLog runId={run.id} job={job} />;
  if (tab === "telemetry") return <RunTelemetry run={run} most={12} height={180} />;
  if (tab === "report") return <RunReportTab runId={run.id} />;
  if (tab === "events") return <Events run={run} most={null} link={props.link} />;
  return (
    <>
      <StepStrip steps={steps} picked={picked} onPick={pickStep} />
      <Timeline run={run} picked={job} onPick={pick} />
      <RunFiles run={run} />
      <div className="two">
        <RunTelemetry run={run} most={2} />
        <Events run={run} most={8} link={props.link} />
      </div>
    </>
  );
}

function Events(props: { run: Run; most: number | null; link: (tab: Tab) => string }) {
  const events = useRunEvents(props.run.id);
  const count = events.data?.length ?? 0;
  return (
    <Card
      title={words.tabs.events}
      note="newest first"
      testId="events"
      actions={
        props.most !== null && count > props.most ? (
          <Link className="t12 s" to={props.link("events")} replace>
            All {countOf(events)}
          </Link>
        ) : null
      }
    >
      <Loaded source={events} what="events">
        {(rows) =>
          rows.length ? (
            <>
              <EventTable events={rows.slice(0, props.most ?? rows.length)} />
              {props.most === null && <More list={events} what="events" />}
            </>
          ) : (
            <Empty>{words.noEvents}</Empty>
          )
        }
      </Loaded>
    </Card>
  );
}

/** A problem card tells all of it already. */
const hasCard = (job: Job): boolean =>
  isTakenAway(job) ||
  (!job.passed_by && ["in_doubt", "aborted", "rejected", "stopped"].includes(job.state));

function JobCard({ run, job: id }: { run: Run; job: string }) {
  const job = run.jobs.find((item) => item.id === id);
  if (!job || hasCard(job)) return null;
  return <JobFacts job={job} />;
}
