/** Calls to the server: one shape of request, one shape of refusal. */

import type { Finding, Refusal } from "@/model/wire";
import { sentence } from "@/model/format";
import { useConnection } from "./connection";
import { askPassword } from "./signing";
import { once } from "./wish";

/** The server said no, or did not answer at all (status 0). */
export class ApiError extends Error {
  readonly status: number;
  readonly refusal: Refusal;
  /** Send the same wish again, under the same key; undefined: it was answered. */
  again: (() => void) | undefined;

  constructor(status: number, refusal: Refusal) {
    super(refusal.message);
    this.name = "ApiError";
    this.status = status;
    this.refusal = refusal;
  }

  get code(): string {
    return this.refusal.code;
  }

  get findings(): Finding[] {
    return this.refusal.findings;
  }

  /** Nobody knows whether it was carried out: no answer came, or the server failed at it. */
  get isUnanswered(): boolean {
    return this.status === 0 || this.status >= 500 || this.code === "http.in_progress";
  }

  /** The session has ended: sign in, then come back. */
  get isSignedOut(): boolean {
    return this.refusal.code === "http.not_authenticated";
  }
}

type Method = "GET" | "POST" | "PUT" | "DELETE";

let onSignedOut: () => void = () => undefined;

/** Say what happens when an answer shows that the session has ended. */
export function whenSignedOut(callback: () => void): void {
  onSignedOut = callback;
}

export function csrfToken(): string {
  return /(?:^|;\s*)csrftoken=([^;]+)/.exec(document.cookie)?.[1] ?? "";
}

/** A finding with its message as a sentence; one about source begins with a name of the source. */
export const spoken = (finding: Finding): Finding =>
  /^driver\.drv\d/.test(finding.code)
    ? finding
    : { ...finding, message: sentence(finding.message) };

export function refusal(code: string, message: string): Refusal {
  return { code, message, effect: "none", context: {}, findings: [] };
}

export async function readRefusal(response: Response): Promise<Refusal> {
  const fallback = refusal(`http.${response.status}`, `The server answered ${response.status}.`);
  try {
    const body = (await response.json()) as Partial<Refusal>;
    if (typeof body.message !== "string") return fallback;
    return {
      ...fallback,
      ...body,
      message: sentence(body.message),
      findings: (body.findings ?? []).map(spoken),
    };
  } catch {
    return fallback;
  }
}

/** How long the page waits for the answer to what acts; a recipe is compiled for minutes. */
const patienceOf = (path: string): number => (path.startsWith("/recipes/") ? 300_000 : 30_000);

const ASK_AGAIN_MS = 1000;
const MOST_TIMES = 10;

/** Whether the server has had its last word on a wish. */
export function isFinal(error: unknown): boolean {
  return error instanceof ApiError && !error.isUnanswered;
}

/**
 * Call the server and return its answer. What acts is sent once, however often it is pressed, and
 * under one key until the server has answered; what a `signal` may end only reads.
 */
export async function call<T>(
  method: Method,
  path: string,
  body?: unknown,
  signal?: AbortSignal,
): Promise<T> {
  if (method === "GET" || signal) return send<T>(method, path, body, { signal });
  const wish = `${method} ${path} ${JSON.stringify(body) ?? ""}`;
  return once(wish, (key) => insist<T>(method, path, body, key), isFinal);
}

/**
 * Send what acts, and ask for its answer while the server says that it is being carried out. What is
 * signed waits until the person has typed the password; whoever gives up gets the server's refusal.
 */
async function insist<T>(method: Method, path: string, body: unknown, key: string): Promise<T> {
  for (let count = 1; ; count += 1) {
    try {
      return await send<T>(method, path, body, { key });
    } catch (error) {
      const code = error instanceof ApiError ? error.code : "";
      if (code === "session.confirm" && (await askPassword())) continue;
      const isUnderWay = code === "http.in_progress";
      if (!isUnderWay || count === MOST_TIMES) throw error;
      await new Promise((wake) => setTimeout(wake, ASK_AGAIN_MS));
    }
  }
}

async function send<T>(
  method: Method,
  path: string,
  body: unknown,
  { key, signal }: { key?: string; signal?: AbortSignal | undefined },
): Promise<T> {
  const headers: Record<string, string> = { Accept: "application/json" };
  if (body !== undefined) headers["Content-Type"] = "application/json";
  if (method !== "GET") headers["X-CSRFToken"] = csrfToken();
  if (key !== undefined) headers["Idempotency-Key"] = key;
  const limit =
    key !== undefined
      ? AbortSignal.timeout(patienceOf(path))
      : method === "GET"
        ? limited(signal)
        : signal;
  let response: Response;
  try {
    response = await fetch(`/api/v1${path}`, {
      method,
      headers,
      credentials: "same-origin",
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
      ...(limit ? { signal: limit } : {}),
    });
  } catch (error) {
    if (key !== undefined && limit?.aborted)
      throw new ApiError(0, refusal("http.no_answer", "The server has not answered."));
    if (signal?.aborted !== true && limit?.aborted) throw tooLate();
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    useConnection.getState().setReachable(false);
    throw new ApiError(0, refusal("http.unreachable", "The server does not answer."));
  }
  const isGateway = [502, 503, 504].includes(response.status);
  useConnection.getState().setReachable(!isGateway);
  if (!response.ok) {
    const error = new ApiError(response.status, await readRefusal(response));
    if (error.isSignedOut) onSignedOut();
    throw error;
  }
  if (response.status === 204) return undefined as T;
  try {
    return (await response.json()) as T;
  } catch (error) {
    if (signal?.aborted) throw error;
    if (limit?.aborted) throw tooLate();
    const message = "The server answered something that is no JSON.";
    throw new ApiError(response.status, refusal("http.no_json", message));
  }
}

/** How long an answer that only tells may take; what acts is waited for without a limit. */
const LONGEST_S = 30;

function limited(signal: AbortSignal | undefined): AbortSignal {
  const limit = AbortSignal.timeout(LONGEST_S * 1000);
  return signal ? AbortSignal.any([signal, limit]) : limit;
}

function tooLate(): ApiError {
  useConnection.getState().setReachable(false);
  const message = `The server did not answer within ${LONGEST_S} s.`;
  return new ApiError(0, refusal("http.timeout", message));
}

/** Sentence for any error, for the place where it happened. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : "Something failed without saying why.";
}
