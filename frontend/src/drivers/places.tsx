/** Which device has which version, how far a change has come on its host, and the change itself. */

import { useState } from "react";
import { Link } from "react-router";
import { newestFirst, progressOf, STAGES } from "@/model/drivers";
import { formatDigest } from "@/model/format";
import { sessionState } from "@/model/hosts";
import type { DriverDetail, DriverPlace, DriverRow } from "@/model/wiredrivers";
import { Card, Empty } from "@/ui/card";
import { Button } from "@/ui/controls";
import { Glyph } from "@/ui/glyph";
import { StateText } from "@/ui/state";
import { ChangeVersion } from "./changeversion";
import { candidatesOf, GiveToMany } from "./givemany";
import { words } from "./words";

interface Props {
  driver: DriverDetail;
  versions: DriverRow[];
}

export function Places({ driver, versions }: Props) {
  const [asked, setAsked] = useState<string | null>(null);
  const [isMany, setIsMany] = useState(false);
  const place = driver.places.find((one) => one.id === asked);
  const candidates = candidatesOf(driver);
  return (
    <Card
      title={words.places.title}
      note={driver.places.length ? String(driver.places.length) : null}
      testId="driver-places"
      actions={
        candidates.length > 1 && (
          <Button testId="driver-many" onClick={() => setIsMany(true)}>
            {words.places.many.open}
          </Button>
        )
      }
    >
      {driver.places.length === 0 && <Empty>{words.places.none}</Empty>}
      <ul className="places">
        {driver.places.map((one) => (
          <Place
            key={one.id}
            place={one}
            driver={driver}
            versions={versions}
            onAsk={() => setAsked(one.id)}
          />
        ))}
      </ul>
      {isMany && (
        <GiveToMany driver={driver} candidates={candidates} onClose={() => setIsMany(false)} />
      )}
      {place && (
        <ChangeVersion
          place={place}
          offered={driver.id}
          choices={choicesOf(place, versions)}
          onClose={() => setAsked(null)}
        />
      )}
    </Card>
  );
}

function Place(props: Props & { place: DriverPlace; onAsk: () => void }) {
  const { place, driver } = props;
  const { next, version_id: present, digest } = place.driver;
  const progress = progressOf(place);
  const hasThis = present === driver.id;
  return (
    <li data-testid="driver-place" data-device={place.key} data-stage={stageOf(place)}>
      <span className="who">
        <Link className="b" to={`/devices/${place.id}`}>
          {place.name}
        </Link>
        <span className="s">
          {hasThis ? words.places.has : words.places.hasOther}{" "}
          {!hasThis && (
            <Link className="link mono" to={`/drivers/${present}`}>
              {formatDigest(digest)}
            </Link>
          )}
        </span>
        <span className="t12 m hostof">
          {place.host.name} <StateText state={sessionState(place.host.state)} />
          {place.driver.serving && (
            <span data-testid="place-serving">
              {words.places.serves} {formatDigest(place.driver.serving.digest)}
            </span>
          )}
        </span>
      </span>
      <Button testId="driver-change" why={whyNoChange(props)} onClick={props.onAsk}>
        {verbOf(next !== null, hasThis)}
      </Button>
      {progress.reached !== null && (
        <ol className="stages" aria-label={`Progress of ${place.name}`}>
          {STAGES.map((stage, index) => {
            const isDone = index < (progress.reached ?? 0);
            return (
              <li key={stage} data-done={isDone}>
                <span className={isDone ? "tone-ok" : "tone-idle"}>
                  <Glyph look={isDone ? "ok" : "idle"} />
                </span>
                {words.places.stage[stage]}
              </li>
            );
          })}
        </ol>
      )}
      {progress.text && (
        <p className={progress.isBad ? "help bad" : "help"} role="status">
          {progress.text}
        </p>
      )}
    </li>
  );
}

function stageOf({ driver }: DriverPlace): string {
  if (!driver.next) return driver.problem ? "refused" : "settled";
  return driver.next.is_ready ? "ready" : "staged";
}

function verbOf(isChanging: boolean, hasThis: boolean): string {
  if (isChanging) return words.places.takeBack;
  return hasThis ? words.places.back : words.places.give;
}

function whyNoChange({ place, driver, versions }: Props & { place: DriverPlace }): string | null {
  if (!place.can_change) return words.places.mayNot;
  if (place.driver.next) return null;
  if (place.driver.version_id !== driver.id)
    return driver.state === "approved" ? null : words.places.notApproved;
  return choicesOf(place, versions).length ? null : words.places.noOther;
}

/** Approved versions that the device has not. */
function choicesOf(place: DriverPlace, versions: DriverRow[]): DriverRow[] {
  return newestFirst(versions).filter(
    (row) => row.state === "approved" && row.id !== place.driver.version_id,
  );
}
