/** The clock of the lab: its zone, and the present moment. */

import { createContext, useContext, useEffect, useMemo, useState, type ReactNode } from "react";
import { formatAge, LabTime, toSeconds } from "@/model/format";

const Zone = createContext(new LabTime("UTC"));

export function LabTimeProvider({ zone, children }: { zone: string; children: ReactNode }) {
  const time = useMemo(() => readZone(zone), [zone]);
  return <Zone.Provider value={time}>{children}</Zone.Provider>;
}

function readZone(zone: string): LabTime {
  try {
    return new LabTime(zone);
  } catch {
    return new LabTime("UTC");
  }
}

export function useLabTime(): LabTime {
  return useContext(Zone);
}

/** Seconds since 1970, renewed every `everyMs`. */
export function useNow(everyMs = 1000): number {
  const [now, setNow] = useState(() => Date.now() / 1000);
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now() / 1000), everyMs);
    return () => clearInterval(timer);
  }, [everyMs]);
  return now;
}

/** A time of day with its date and zone on hover. */
export function At({ at, seconds = false }: { at: string | null; seconds?: boolean }) {
  const time = useLabTime();
  if (!at) return <span className="m">–</span>;
  const text = seconds ? time.second(at) : time.near(at, Date.now() / 1000);
  return (
    <time className="num" dateTime={at} title={`${time.full(at)} ${time.zone}`}>
      {text}
    </time>
  );
}

/** How old a value is, renewed as it ages. */
export function Age({ at_s }: { at_s: number | null }) {
  const now = useNow();
  if (at_s === null) return <span className="m">no value yet</span>;
  return (
    <span className="num" data-age-ms={Math.round((now - at_s) * 1000)}>
      {formatAge(now - at_s)}
    </span>
  );
}

/** How long ago something began: "4 min ago". */
export function Since({ at }: { at: string | null }) {
  const now = useNow(5000);
  const begun = toSeconds(at);
  if (begun === null) return null;
  return <span className="num">{formatAge(now - begun)} ago</span>;
}
