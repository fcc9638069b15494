/** A version on trial: an instrument is chosen, then driven by the form that users will see. */

import "./drivers.css";
import "./try.css";
import { Link, useParams, useSearchParams } from "react-router";
import { useDriver } from "@/api/drivers";
import { useTopics } from "@/api/live";
import { useTryout, useTryouts, useWish } from "@/api/tryouts";
import { formatDigest } from "@/model/format";
import { isLive, tryoutState } from "@/model/tryouts";
import type { DriverDetail } from "@/model/wiredrivers";
import type { Tryout, Tryouts } from "@/model/wiretryouts";
import { Button, Refused } from "@/ui/controls";
import { PageState, PartState } from "@/ui/pagestate";
import { StateChip } from "@/ui/state";
import { Since } from "@/ui/time";
import { Begin, Earlier } from "./trybegin";
import { Deeds, Faults, Line, Log, Told } from "./trydrive";
import { words } from "./words";

const TOPICS = ["drivers", "tryouts", "hosts"] as const;

export function TryPage() {
  const { id = "" } = useParams();
  const driver = useDriver(id);
  const tryouts = useTryouts(id);
  useTopics(...TOPICS);
  const error = driver.error ?? tryouts.error;
  if (driver.data && tryouts.data)
    return <Trying key={id} driver={driver.data} about={tryouts.data} />;
  return (
    <PageState
      of="driver"
      error={error}
      retry={() => Promise.all([driver.refetch(), tryouts.refetch()])}
    />
  );
}

function Trying({ driver, about }: { driver: DriverDetail; about: Tryouts }) {
  const [params, setParams] = useSearchParams();
  const asked = params.get("on") ?? about.tryouts.find(isLive)?.id ?? null;
  const tryout = useTryout(asked);
  const open = (on: string | null): void => setParams(on ? { on } : { on: "new" });
  const isNew = params.get("on") === "new" || asked === null;
  const shown = isNew ? undefined : tryout.data;
  return (
    <div className="wrap devpage drivers trying" data-testid="try" data-state={shown?.state ?? ""}>
      <div className="hd wrapping">
        <Link className="crumb" to="/drivers">
          {words.title}
        </Link>
        <span className="m">/</span>
        <Link className="crumb" to={`/drivers/${driver.id}`}>
          {driver.class_name} <span className="mono">{formatDigest(driver.digest)}</span>
        </Link>
        <span className="m">/</span>
        <h1>{words.trying.title}</h1>
        {shown && <StateChip state={tryoutState(shown)} />}
        <i className="sp" />
        {shown && <Ending tryout={shown} onAgain={() => open(null)} />}
      </div>
      {!isNew && tryout.error && (
        <div className="card">
          <PartState of="tryout" error={tryout.error} retry={tryout.refetch} />
        </div>
      )}
      {isNew && (
        <>
          <div className="col">
            <Begin driver={driver} about={about} onBegun={open} />
          </div>
          <aside className="col">
            <Earlier about={about} onOpen={open} />
          </aside>
        </>
      )}
      {shown && <Driven driver={driver} tryout={shown} />}
    </div>
  );
}

function Ending({ tryout, onAgain }: { tryout: Tryout; onAgain: () => void }) {
  const wish = useWish(tryout.id);
  if (!isLive(tryout))
    return (
      <Button testId="try-again" look="pri" onClick={onAgain}>
        {words.trying.again}
      </Button>
    );
  return (
    <Button
      testId="try-end"
      why={tryout.state === "starting" ? words.trying.starting : null}
      disabled={wish.isPending}
      onClick={() => wish.mutate({ sort: "end" })}
    >
      {words.trying.end}
    </Button>
  );
}

function Driven({ driver, tryout }: { driver: DriverDetail; tryout: Tryout }) {
  const wish = useWish(tryout.id);
  const ask = wish.mutate;
  return (
    <>
      <p className="trynote s" role="status" data-testid="try-note">
        <b>{tryout.title}</b> {words.trying.on} {tryout.host.name}, {tryout.speed}×,{" "}
        {words.trying.by} {tryout.begun_by} <Since at={tryout.begun_at} />. {noteOf(tryout)}
      </p>
      <div className="col">
        <Refused error={wish.error} />
        <Deeds driver={driver} tryout={tryout} ask={ask} />
        <Log driver={driver} tryout={tryout} />
        <Line tryout={tryout} />
      </div>
      <aside className="col">
        <Told driver={driver} tryout={tryout} ask={ask} />
        <Faults tryout={tryout} ask={ask} />
      </aside>
    </>
  );
}

function noteOf(tryout: Tryout): string {
  if (tryout.state === "starting") return words.trying.startingNote;
  if (tryout.state === "running") return words.trying.runningNote;
  return `${words.trying.ended} ${tryout.message}.`;
}
