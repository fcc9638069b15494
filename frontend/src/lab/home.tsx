/** Home: what needs a person, then what runs, then the bench. */

import { Link, useNavigate } from "react-router";
import { useHome, useSession } from "@/api/queries";
import { useTopics } from "@/api/live";
import { runOutcome } from "@/model/decisions";
import { lagText, sessionState } from "@/model/hosts";
import { isLiveRun, needState } from "@/model/states";
import type { HostRow, Need, RunRow, WorkflowRow } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { Icon } from "@/ui/icons";
import { StateChip, StateGlyph } from "@/ui/state";
import { Age, At, Since, useLabTime, useNow } from "@/ui/time";
import { RunTable } from "@/ui/runtable";
import { BenchGrid } from "@/ui/devicetile";
import { formatAge, lineWords, toSeconds } from "@/model/format";
import { useReset } from "./stop";
import { words } from "./words";

export function HomePage() {
  const home = useHome();
  useTopics("workflows", "events");
  return (
    <div className="wrap home" data-testid="home">
      <Head needs={home.data?.needs_you} />
      <Loaded source={home} what="Home">
        {(data) => (
          <>
            <div className="col">
              <Needs needs={data.needs_you} last={data.last_results[0]} />
              <Running runs={data.running} />
              <Card
                title={words.home.bench}
                note={deviceNote(data.devices)}
                actions={
                  <Link className="t12 s" to="/twin">
                    {words.nav.twin}
                  </Link>
                }
              >
                {data.devices.length ? (
                  <BenchGrid devices={data.devices} />
                ) : (
                  <Empty>{words.home.noDevices}</Empty>
                )}
              </Card>
            </div>
            <aside className="col">
              <LastResults runs={data.last_results} />
              <RecentWorkflows workflows={data.workflows} />
              {data.hosts.map((host) => (
                <Host key={host.id} host={host} />
              ))}
            </aside>
          </>
        )}
      </Loaded>
    </div>
  );
}

function Head({ needs }: { needs: Need[] | undefined }) {
  const now = useNow(10_000);
  const time = useLabTime();
  return (
    <div className="hd">
      <h1>{words.home.needs}</h1>
      {needs && <span className="s wide">{summary(needs, now)}</span>}
      <span className="sp" />
      <span className="m num t12" title={time.zone}>
        {time.long(now)} {time.zone}
      </span>
    </div>
  );
}

function summary(needs: Need[], now: number): string {
  const begun = needs.map((need) => toSeconds(need.since_at)).filter((at) => at !== null);
  if (!needs.length) return "";
  const items = needs.length === 1 ? "1 item." : `${needs.length} items.`;
  return begun.length
    ? `${items} The oldest has waited ${formatAge(now - Math.min(...begun))}.`
    : items;
}

function deviceNote(devices: { link: string }[]): string {
  const away = devices.filter((device) => device.link !== "online").length;
  const all = devices.length === 1 ? "1 device" : `${devices.length} devices`;
  return away ? `${all}, ${away} not online` : all;
}

function Needs({ needs, last }: { needs: Need[]; last: RunRow | undefined }) {
  const navigate = useNavigate();
  const askReset = useReset((state) => state.ask);
  const stop = useSession().data?.lab?.stop.stop_id ?? null;
  const act = (need: Need): void => {
    if (need.kind === "stopped") askReset(stop);
    else if (need.url.startsWith("/admin/")) window.location.assign(need.url);
    else void navigate(need.url);
  };
  if (!needs.length) {
    return (
      <section className="card" aria-label={words.home.needs}>
        <Empty>
          <span>
            {words.home.nothing}{" "}
            {last?.ended_at && (
              <>
                Last run ended <At at={last.ended_at} />.
              </>
            )}
          </span>
        </Empty>
      </section>
    );
  }
  return (
    <section className="card needs" aria-label={words.home.needs} data-testid="needs">
      <ol>
        {needs.map((need, place) => (
          <NeedRow
            key={`${need.kind}${need.url}${need.job_id ?? ""}${place}`}
            need={need}
            isFirst={place === 0}
            act={() => act(need)}
          />
        ))}
      </ol>
    </section>
  );
}

function NeedRow({ need, isFirst, act }: { need: Need; isFirst: boolean; act: () => void }) {
  const state = needState(need.kind);
  return (
    <li data-kind={need.kind}>
      <span className="tile" data-state={state.look}>
        <Glyph look={state.look} />
      </span>
      <div className="tx">
        {need.url ? (
          <Link className="t14 b" to={need.url} reloadDocument={need.url.startsWith("/admin/")}>
            {need.title}
          </Link>
        ) : (
          <span className="t14 b">{need.title}</span>
        )}
        <p className="t12 s">
          {need.detail.startsWith(state.word) ? "" : `${state.word} · `}
          {lineWords(need.detail)}
        </p>
      </div>
      <div className="when">
        {need.since_at && (
          <>
            <b>
              <Since at={need.since_at} />
            </b>
            <span className="t12 m">
              since <At at={need.since_at} />
            </span>
          </>
        )}
      </div>
      {need.verb && (
        <Button look={isFirst ? "pri" : ""} onClick={act}>
          {need.verb}
        </Button>
      )}
    </li>
  );
}

function Running({ runs }: { runs: RunRow[] }) {
  const queued = runs.filter((run) => run.state === "queued").length;
  const active = runs.filter((run) => isLiveRun(run.state)).length - queued;
  return (
    <Card
      title={words.home.running}
      note={runs.length ? `${active} now${queued ? `, ${queued} queued` : ""}` : null}
      actions={
        <Link className="t12 s" to="/runs">
          {words.home.allRuns}
        </Link>
      }
    >
      {runs.length ? (
        <RunTable runs={runs} />
      ) : (
        <Empty>
          {words.home.noneRunning}
          <Link className="btn" to="/workflows">
            {words.home.choose}
          </Link>
        </Empty>
      )}
    </Card>
  );
}

function LastResults({ runs }: { runs: RunRow[] }) {
  return (
    <Card title={words.home.results}>
      {runs.length ? (
        <ol className="list">
          {runs.map((run) => (
            <li key={run.id}>
              <StateGlyph state={runOutcome(run)} />
              <span className="tx2">
                <Link className="cut b" to={`/runs/${run.id}`}>
                  {run.workflow.name}
                </Link>
                <span className="t12 m cut">
                  #{run.number} · {run.mode === "sim" ? "SIM · " : ""}
                  {runOutcome(run).word.toLowerCase()}
                </span>
              </span>
              <span className="m t12">
                <At at={run.ended_at} />
              </span>
            </li>
          ))}
        </ol>
      ) : (
        <Empty>{words.home.noResults}</Empty>
      )}
    </Card>
  );
}

function RecentWorkflows({ workflows }: { workflows: WorkflowRow[] }) {
  return (
    <Card
      title={words.home.workflows}
      actions={
        <Link className="ib" to="/workflows?new=1" aria-label="New workflow">
          <Icon name="plus" />
        </Link>
      }
    >
      {workflows.length ? (
        <ol className="list">
          {workflows.map((workflow) => (
            <li key={workflow.id}>
              <span className="tx2">
                <Link className="cut b" to={`/workflows/${workflow.id}/edit`}>
                  {workflow.name}
                </Link>
                <span className="t12 m cut">
                  {workflow.latest_version ? `v${workflow.latest_version.number}` : "draft"}
                  {`, ${workflow.steps_count} ${workflow.steps_count === 1 ? "step" : "steps"}`}
                </span>
              </span>
              <span className="m t12">
                <At at={workflow.updated_at} />
              </span>
            </li>
          ))}
        </ol>
      ) : (
        <Empty>{words.home.noWorkflows}</Empty>
      )}
    </Card>
  );
}

function Host({ host }: { host: HostRow }) {
  return (
    <Card title={words.home.hosts} note={host.name}>
      <div className="host">
        <span className="s">State</span>
        <span className="wf">
          <StateChip state={sessionState(host.state)} />
          {host.away_since_at && (
            <span>
              since <At at={host.away_since_at} />
            </span>
          )}
        </span>
        <span className="s">Last heard</span>
        <span>
          <Age at_s={toSeconds(host.last_seen_at)} />
        </span>
        <span className="s">Devices</span>
        <span className="num">{host.devices_count}</span>
        <span className="s">Journal not synced</span>
        <span className="num">{lagText(host)}</span>
      </div>
    </Card>
  );
}
