import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { LiveSocket, type Message } from "./socket";

/** The far end of a websocket, driven by the test. */
class FarEnd {
  static readonly OPEN = 1;
  static all: FarEnd[] = [];
  readyState = 0;
  sent: Record<string, unknown>[] = [];
  onopen: () => void = () => undefined;
  onmessage: (event: { data: string }) => void = () => undefined;
  onclose: (event: { code: number }) => void = () => undefined;

  constructor(readonly url: string) {
    FarEnd.all.push(this);
  }

  send(text: string): void {
    this.sent.push(JSON.parse(text) as Record<string, unknown>);
  }

  close(): void {
    this.drop(1000);
  }

  accept(): void {
    this.readyState = 1;
    this.onopen();
  }

  tell(frame: unknown): void {
    this.onmessage({ data: JSON.stringify(frame) });
  }

  drop(code: number): void {
    this.readyState = 3;
    this.onclose({ code });
  }
}

const last = (): FarEnd => {
  const end = FarEnd.all.at(-1);
  if (!end) throw new Error("nothing was opened");
  return end;
};

function open(): { live: LiveSocket; log: string[]; heard: Message[] } {
  const log: string[] = [];
  const heard: Message[] = [];
  const live = new LiveSocket("ws://lab/ws/v1/", {
    onOpen: (isAgain) => log.push(isAgain ? "again" : "open"),
    onClose: (code) => log.push(`close ${code}`),
    onGap: (topic) => log.push(`gap ${topic}`),
    onLatency: () => log.push("latency"),
  });
  live.listen("runs", (message) => heard.push(message));
  live.start();
  last().accept();
  return { live, log, heard };
}

beforeEach(() => {
  FarEnd.all = [];
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", FarEnd);
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

test("topics asked for before the connection are subscribed once it is open", () => {
  open();
  expect(last().sent[0]).toEqual({ subscribe: ["runs"] });
});

test("a gap in the sequence asks for a fresh fetch, and the message is still heard", () => {
  const { log, heard } = open();
  last().tell({ topic: "runs", seq: 1, at: "", data: {} });
  last().tell({ topic: "runs", seq: 3, at: "", data: {} });
  expect(log).toEqual(["open", "gap runs"]);
  expect(heard).toHaveLength(2);
});

test("after a loss it connects again, subscribes again and says so", () => {
  const { log } = open();
  last().drop(1006);
  vi.advanceTimersByTime(600);
  expect(FarEnd.all).toHaveLength(2);
  last().accept();
  expect(last().sent[0]).toEqual({ subscribe: ["runs"] });
  expect(log).toEqual(["open", "close 1006", "again"]);
});

test("who is not signed in any more is not tried again once the page knows", () => {
  const { live } = open();
  last().drop(4401);
  live.stop();
  vi.advanceTimersByTime(60_000);
  expect(FarEnd.all).toHaveLength(1);
});

test("who is still signed in, by another session, is heard again", () => {
  const { log } = open();
  last().drop(4401);
  vi.advanceTimersByTime(7900);
  expect(FarEnd.all).toHaveLength(1);
  vi.advanceTimersByTime(200);
  expect(FarEnd.all).toHaveLength(2);
  last().accept();
  expect(log).toEqual(["open", "close 4401", "again"]);
});

test("what was fetched before a first connection that took several tries is fetched again", () => {
  const log: string[] = [];
  const live = new LiveSocket("ws://lab/ws/v1/", {
    onOpen: (isAgain) => log.push(isAgain ? "again" : "open"),
    onClose: () => undefined,
    onGap: () => undefined,
    onLatency: () => undefined,
  });
  live.start();
  last().drop(1006);
  vi.advanceTimersByTime(600);
  last().accept();
  expect(log).toEqual(["again"]);
});

test("a connection that is slow to end leaves no pulse beside that of the next", () => {
  const { live } = open();
  last().close = () => undefined;
  live.stop();
  live.start();
  last().accept();
  vi.advanceTimersByTime(5000);
  const pings = last().sent.filter((frame) => "ping" in frame);
  expect(pings).toHaveLength(2);
});

test("a server that falls silent counts as lost", () => {
  const { log } = open();
  vi.advanceTimersByTime(20_000);
  expect(log).toContain("close 4000");
});

test("the answer to a ping gives the latency", () => {
  const { log } = open();
  last().tell({ pong: 1 });
  expect(log).toEqual(["open", "latency"]);
});

test("the last listener that leaves ends the subscription", () => {
  const { live } = open();
  const end = live.listen("lab", () => undefined);
  end();
  expect(last().sent.slice(-2)).toEqual([{ subscribe: ["lab"] }, { unsubscribe: ["lab"] }]);
});
