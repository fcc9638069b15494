/** One wish is one request to the server, however often it is pressed or sent. */

/** How long a press after the first counts as the same one: the slowest double click. */
const DOUBLE_MS = 800;

/** How long a wish whose outcome is unknown keeps its key; later the same words are a new wish. */
const KEEP_MS = 3_600_000;

interface Wish {
  answer: Promise<unknown>;
  isOver: boolean;
}

interface Key {
  key: string;
  at: number;
}

/** Wishes under way, and the last one that was granted, by what they ask for. */
const asked = new Map<string, Wish>();

/** The key of each wish without a final answer; in the tab, too, so that a reload keeps it. */
const keys = new Map<string, Key>();

/** A text of any length as a short one that hardly any other text has. */
function short(text: string): string {
  let high = 0xdeadbeef;
  let low = 0x41c6ce57;
  for (let place = 0; place < text.length; place += 1) {
    const code = text.charCodeAt(place);
    high = Math.imul(high ^ code, 2654435761);
    low = Math.imul(low ^ code, 1597334677);
  }
  return `${text.length}-${(high >>> 0).toString(36)}${(low >>> 0).toString(36)}`;
}

/** 128 random bits; `crypto.randomUUID` is missing where the page came without TLS. */
function newKey(): string {
  const bytes = [...crypto.getRandomValues(new Uint8Array(16))];
  return bytes.map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function readKey(place: string): Key | undefined {
  const text = sessionStorage.getItem(place);
  return text === null ? undefined : (JSON.parse(text) as Key);
}

function keyOf(place: string): string {
  const known = keys.get(place) ?? readKey(place);
  if (known && Date.now() - known.at < KEEP_MS) return known.key;
  const fresh = { key: newKey(), at: Date.now() };
  keys.set(place, fresh);
  try {
    sessionStorage.setItem(place, JSON.stringify(fresh));
  } catch {
    // The browser's room is full: a reload forgets the key, and nothing else does.
    sessionStorage.removeItem(place);
  }
  return fresh.key;
}

function settle(place: string): void {
  keys.delete(place);
  sessionStorage.removeItem(place);
}

function drop(wish: string, entry: Wish): void {
  if (asked.get(wish) === entry) asked.delete(wish);
}

/**
 * Send a wish once: who asks for the same while it is under way, or presses twice, hears the
 * same answer. While its outcome is unknown the wish keeps its key, so that the server does not
 * do it twice when it is sent again.
 *
 * @param wish What is asked for: method, address and body.
 * @param isFinal Whether an error is the server's last word on it.
 */
export function once<T>(
  wish: string,
  send: (key: string) => Promise<T>,
  isFinal: (error: unknown) => boolean,
): Promise<T> {
  const known = asked.get(wish);
  if (known) return known.answer as Promise<T>;
  for (const [other, { isOver }] of asked) if (isOver) asked.delete(other);
  const place = `labweb.wish/${short(wish)}`;
  const sentAt = Date.now();
  const entry: Wish = { answer: Promise.resolve(), isOver: false };
  const answer = send(keyOf(place)).then(
    (told) => {
      settle(place);
      entry.isOver = true;
      setTimeout(() => drop(wish, entry), sentAt + DOUBLE_MS - Date.now());
      return told;
    },
    (error: unknown) => {
      if (isFinal(error)) settle(place);
      drop(wish, entry);
      throw error;
    },
  );
  entry.answer = answer;
  asked.set(wish, entry);
  return answer;
}

/** Forget every wish: somebody else uses the page now. */
export function forgetWishes(): void {
  asked.clear();
  keys.clear();
}
