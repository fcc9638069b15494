/** The lab as a tree: what stands where, and what it holds, now or at any time before. */

import "./lab.css";
import { useId } from "react";
import { useSearchParams } from "react-router";
import { useTopics } from "@/api/live";
import { usePast, useResources } from "@/api/queries";
import type { ResourceRow } from "@/model/wire";
import { Card, Empty, Loaded } from "@/ui/card";
import { Button } from "@/ui/controls";
import { Downloads } from "@/ui/downloads";
import { useLabTime } from "@/ui/time";
import { ContentsTable, ResourceInspector, Wells } from "./inspector";
import type { StockAsked } from "./stock";
import { TicketDialog } from "./ticket";
import { ResourceTree } from "./tree";
import { words } from "./words";

export function LabPage() {
  const [params, setParams] = useSearchParams();
  const set = (name: string, value: string | null): void => {
    if (value === null) params.delete(name);
    else params.set(name, value);
    setParams(params, { replace: true });
  };
  const at = params.get("at");
  const picked = params.get("sel");
  const pick = (id: string): void => {
    params.delete("stock");
    set("sel", id);
  };
  const ticket = params.get("ticket");
  const ask: StockAsked = {
    isAsked: params.get("stock") === "1",
    onAsk: (isAsked) => set("stock", isAsked ? "1" : null),
  };
  return (
    <div className="wrap labpage" data-testid="lab" data-at={at ?? undefined}>
      <div className="hd wrapping">
        <h1>{words.tree.title}</h1>
        <i className="sp" />
        <Moment at={at} onChange={(next) => set("at", next)} />
        <Exports at={at} />
      </div>
      {at === null ? (
        <Present picked={picked} onPick={pick} ask={ask} />
      ) : (
        <Past at={at} picked={picked} onPick={pick} />
      )}
      {ticket !== null && (
        <TicketDialog key={ticket} id={ticket} onClose={() => set("ticket", null)} />
      )}
    </div>
  );
}

/** The lab as files; of a moment that has passed, what it held. */
function Exports({ at }: { at: string | null }) {
  const { contents, lots, lab, uniLabOs } = words.exports;
  const then = at === null ? "" : `?${new URLSearchParams({ at }).toString()}`;
  const present = [
    { ...lots, path: "lots/export", name: "lots.csv" },
    { ...lab, path: "lab/export", name: "lab.json" },
    { ...uniLabOs, path: "lab/export?form=uni-lab-os", name: "uni-lab-os.json" },
  ];
  return (
    <Downloads
      files={[
        { ...contents, path: `resources/contents${then}`, name: "contents.csv" },
        ...(at === null ? present : []),
      ]}
    />
  );
}

/** The clock of the lab, set back. */
function Moment({ at, onChange }: { at: string | null; onChange: (at: string | null) => void }) {
  const id = useId();
  const time = useLabTime();
  return (
    <span className="moment">
      <label htmlFor={id} className="s">
        {words.past.label}
      </label>
      <input
        id={id}
        type="datetime-local"
        step={1}
        className="inp num"
        title={time.zone}
        data-testid="as-it-was"
        value={at === null ? "" : time.field(at)}
        max={time.field(Date.now() / 1000)}
        onChange={(event) => onChange(time.instant(event.target.value))}
      />
      {at !== null && (
        <Button testId="back-to-now" onClick={() => onChange(null)}>
          {words.past.now}
        </Button>
      )}
    </span>
  );
}

interface Picking {
  picked: string | null;
  onPick: (id: string) => void;
}

function Present({ picked, onPick, ask }: Picking & { ask: StockAsked }) {
  const resources = useResources();
  useTopics("events", "devices");
  return (
    <>
      <Card title="Resources" note={resources.data ? String(resources.data.length) : null}>
        <Loaded source={resources} what="resources">
          {(rows) => <ResourceTree rows={rows} picked={picked} onPick={onPick} />}
        </Loaded>
      </Card>
      <section className="card rcard" aria-label="Resource">
        <ResourceInspector id={picked} ask={ask} />
      </section>
    </>
  );
}

function Past({ at, picked, onPick }: Picking & { at: string }) {
  const past = usePast(at);
  const time = useLabTime();
  const row = past.data?.find((one) => one.id === picked);
  return (
    <>
      <Card title="Resources" note={`${time.day(at)} ${time.second(at)}`}>
        <Loaded source={past} what="the lab as it was">
          {(rows) => <ResourceTree rows={rows} picked={picked} onPick={onPick} />}
        </Loaded>
      </Card>
      <section className="card rcard" aria-label="Resource">
        {row && past.data ? (
          <PastResource row={row} rows={past.data} />
        ) : (
          <Empty>{words.tree.pick}</Empty>
        )}
      </section>
    </>
  );
}

function PastResource({ row, rows }: { row: ResourceRow; rows: ResourceRow[] }) {
  const parent = rows.find((one) => one.id === row.parent_id);
  return (
    <div className="rdetail" data-testid="past-resource" data-resource={row.id}>
      <header>
        <h2>{row.name}</h2>
        <span className="m">{row.kind_label}</span>
      </header>
      <p className="help">{words.past.about}</p>
      {row.holds_liquid && <ContentsTable resource={row} />}
      <Wells resource={row} rows={rows} />
      <dl className="kv">
        <dt>Key</dt>
        <dd className="mono">{row.key}</dd>
        <dt>Stood in</dt>
        <dd>{parent?.name ?? "nothing"}</dd>
        {row.is_quarantined && (
          <>
            <dt>State</dt>
            <dd>{words.tree.quarantined}</dd>
          </>
        )}
      </dl>
    </div>
  );
}
