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

/** State of this tab by a name, until it is sent: its value, how to change and how to forget it. */
export function useKept<T>(name: string, initial: T): [T, (value: T) => void, () => void] {
  const [value, setValue] = useState(() => read(placeOf(name), initial));
  const set = (next: T): void => {
    setValue(next);
    try {
      sessionStorage.setItem(placeOf(name), JSON.stringify(next));
    } catch {
      // The browser's room is full: what is on the page stays there.
      sessionStorage.removeItem(placeOf(name));
    }
  };
  const forget = (): void => {
    setValue(initial);
    sessionStorage.removeItem(placeOf(name));
  };
  return [value, set, forget];
}
