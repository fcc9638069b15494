/** What a person has written and not sent outlives the page: a session or a server may end. */

import { useState } from "react";
import type { Session } from "@/model/wire";
import { keys } from "./keys";
import { client } from "./live";

/** Of whoever is signed in: nobody finds what somebody else wrote in the same tab. */
function placeOf(name: string): string {
  const user = client.getQueryData<Session>(keys.session)?.user;
  return `labweb.kept/${user?.id ?? ""}/${name}`;
}

function read<T>(place: string, initial: T): T {
  const text = sessionStorage.getItem(place);
  return text === null ? initial : (JSON.parse(text) as T);
}

/**
 * State of this tab by a name, until it is sent: its value, how to change and how to forget it.
 * With another name it is what was written by that one.
 */
export function useKept<T>(name: string, initial: T): [T, (value: T) => void, () => void] {
  const place = placeOf(name);
  const [kept, keep] = useState(() => ({ place, value: read(place, initial) }));
  const value = kept.place === place ? kept.value : read(place, initial);
  const set = (next: T): void => {
    keep({ place, value: next });
    try {
      sessionStorage.setItem(place, JSON.stringify(next));
    } catch {
      // The browser's room is full: what is on the page stays there.
      sessionStorage.removeItem(place);
    }
  };
  const forget = (): void => {
    keep({ place, value: initial });
    sessionStorage.removeItem(place);
  };
  return [value, set, forget];
}
