// @vitest-environment jsdom
import { fireEvent, screen, waitFor } from "@testing-library/react";
import { useEffect } from "react";
import { afterEach, expect, test, vi } from "vitest";
import { serve, show } from "@/testpage";
import { Button, Refused } from "@/ui/controls";
import { useAct } from "@/api/act";
import { call } from "@/api/client";
import { forgetWishes } from "@/api/wish";

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

function Pump({ onDone = () => undefined }: { onDone?: () => void }) {
  const act = useAct<unknown, number>({
    mutationFn: (volume) => call("POST", "/operations", { volume }),
  });
  return (
    <>
      <Button onClick={() => act.mutate(5, { onSuccess: onDone })}>Aspirate</Button>
      <Button onClick={() => act.mutate(6)}>Aspirate more</Button>
      <Refused error={act.error} />
    </>
  );
}

/** Answer each call with what `answers` says next; the keys that came. */
function keysOf(...answers: (() => Promise<Response>)[]): string[] {
  const keys: string[] = [];
  vi.stubGlobal("fetch", (_path: string, init: RequestInit) => {
    keys.push((init.headers as Record<string, string>)["Idempotency-Key"] ?? "");
    return (answers.shift() ?? (() => Promise.resolve(new Response("{}"))))();
  });
  return keys;
}

const lost = (): Promise<Response> => Promise.reject(new TypeError("Failed to fetch"));
const press = (name: string): boolean => fireEvent.click(screen.getByRole("button", { name }));

test("an effect that acts once does so once, however often the page is drawn", async () => {
  const sent = serve(() => [201, {}]);
  function Once() {
    const { mutate } = useAct<unknown>({ mutationFn: () => call("POST", "/operations", {}) });
    useEffect(() => mutate(), [mutate]);
    return null;
  }
  const { rerender } = show(<Once />);
  await waitFor(() => expect(sent).toHaveLength(1));
  await new Promise((resolve) => setTimeout(resolve, 900));
  rerender(<Once />);
  await new Promise((resolve) => setTimeout(resolve, 50));
  expect(sent).toHaveLength(1);
});

test("a double click within one tick sends once", async () => {
  const sent = serve(() => [201, {}]);
  const onDone = vi.fn();
  show(<Pump onDone={onDone} />);
  press("Aspirate");
  press("Aspirate");
  await waitFor(() => expect(onDone).toHaveBeenCalledTimes(1));
  expect(sent).toHaveLength(1);
});

test("a slow double click, whose first was answered already, sends once", async () => {
  const sent = serve(() => [201, {}]);
  const onDone = vi.fn();
  show(<Pump onDone={onDone} />);
  press("Aspirate");
  await waitFor(() => expect(onDone).toHaveBeenCalledTimes(1));
  press("Aspirate");
  await waitFor(() => expect(onDone).toHaveBeenCalledTimes(2));
  expect(sent).toHaveLength(1);
});

test("what acts has a key, and another wish has another", async () => {
  const keys = keysOf();
  await call("POST", "/operations", { volume: 1 });
  await call("POST", "/operations", { volume: 2 });
  await call("POST", "/operations", { volume: 1 });
  expect(new Set(keys).size).toBe(3);
  for (const key of keys) expect(key).toMatch(/^[!-~]{8,64}$/);
});

test("an answer that was lost is asked for again under the same key", async () => {
  const keys = keysOf(lost);
  const onDone = vi.fn();
  show(<Pump onDone={onDone} />);
  press("Aspirate");
  await screen.findByText("The server does not answer.");
  press("Try again");
  await waitFor(() => expect(onDone).toHaveBeenCalledTimes(1));
  expect(keys).toHaveLength(2);
  expect(new Set(keys).size).toBe(1);
  expect(screen.queryByText("Try again")).toBeNull();
});

test("a failure of the server leaves the key, and a refusal uses it up", async () => {
  const answer = (status: number) => () =>
    Promise.resolve(new Response('{"message": "no", "code": "x.y"}', { status }));
  const keys = keysOf(answer(503), answer(409));
  for (let count = 0; count < 3; count += 1)
    await call("POST", "/operations", { volume: 1 }).catch(() => undefined);
  expect(keys[1]).toBe(keys[0]);
  expect(keys[2]).not.toBe(keys[0]);
});

test("a reload of the page keeps the key of a wish that was not answered", async () => {
  const keys = keysOf(lost);
  await call("POST", "/operations", { volume: 1 }).catch(() => undefined);
  forgetWishes();
  await call("POST", "/operations", { volume: 1 });
  expect(keys[1]).toBe(keys[0]);
});

test("no answer in time is told, and can be tried again", async () => {
  vi.spyOn(AbortSignal, "timeout").mockReturnValue(
    AbortSignal.abort(new DOMException("too long", "TimeoutError")),
  );
  vi.stubGlobal("fetch", (_path: string, { signal }: RequestInit) =>
    Promise.reject(signal?.reason as Error),
  );
  show(<Pump />);
  press("Aspirate");
  await screen.findByText("The server has not answered.");
  expect(screen.getByTestId("try-again")).toBeEnabled();
});

test("while the server carries it out the answer is asked for under the same key", async () => {
  vi.useFakeTimers();
  const busy = JSON.stringify({ code: "http.in_progress", message: "wait" });
  const keys = keysOf(() => Promise.resolve(new Response(busy, { status: 409 })));
  const answer = call("POST", "/operations", { volume: 1 });
  await vi.advanceTimersByTimeAsync(1100);
  await answer;
  expect(keys).toHaveLength(2);
  expect(new Set(keys).size).toBe(1);
});
