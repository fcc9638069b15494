/** One websocket per tab: topics, sequence gaps, latency, reconnect with back-off. */

import { backOff, SeqTracker } from "@/model/live";

export interface Message {
  topic: string;
  seq: number;
  at: string;
  data: unknown;
}

type Listener = (message: Message) => void;

export interface SocketEvents {
  onOpen: (isAgain: boolean) => void;
  onClose: (code: number) => void;
  /** Something was missed on a topic: fetch again. */
  onGap: (topic: string) => void;
  onLatency: (ms: number) => void;
}

const PING_MS = 5000;
const SILENT_MS = 12_000;
const NOT_SIGNED_IN = 4401;
const SIGNED_OUT_MS = 8000;

/** The live stream of this tab. */
export class LiveSocket {
  private socket: WebSocket | null = null;
  private readonly seqs = new SeqTracker();
  private readonly listeners = new Map<string, Set<Listener>>();
  private attempt = 0;
  private wasOpen = false;
  private retry: ReturnType<typeof setTimeout> | undefined;
  private pulse: ReturnType<typeof setInterval> | undefined;
  private pings = new Map<number, number>();
  private pingCount = 0;
  private heardAt = 0;
  private isWanted = false;

  constructor(
    private readonly url: string,
    private readonly events: SocketEvents,
  ) {}

  start(): void {
    if (this.isWanted) return;
    this.isWanted = true;
    this.attempt = 0;
    this.open();
  }

  stop(): void {
    this.isWanted = false;
    clearTimeout(this.retry);
    this.socket?.close();
  }

  /** Try at once, for the moment when the machine is back on the network. */
  hurry(): void {
    if (!this.isWanted || this.socket) return;
    clearTimeout(this.retry);
    this.open();
  }

  /** Listen to a topic; the returned function ends it. */
  listen(topic: string, listener: Listener): () => void {
    const known = this.listeners.get(topic);
    if (known) known.add(listener);
    else {
      this.listeners.set(topic, new Set([listener]));
      this.send({ subscribe: [topic] });
    }
    return () => this.unlisten(topic, listener);
  }

  private unlisten(topic: string, listener: Listener): void {
    const known = this.listeners.get(topic);
    if (!known?.delete(listener) || known.size > 0) return;
    this.listeners.delete(topic);
    this.seqs.forget(topic);
    this.send({ unsubscribe: [topic] });
  }

  private open(): void {
    const socket = new WebSocket(this.url);
    this.socket = socket;
    socket.onopen = () => this.opened();
    socket.onmessage = (event: MessageEvent<string>) => this.heard(event.data);
    socket.onclose = (event) => this.closed(socket, event.code);
  }

  private opened(): void {
    // What a page fetched before tries that failed may be as old as those.
    const isAgain = this.wasOpen || this.attempt > 0;
    this.wasOpen = true;
    this.attempt = 0;
    this.heardAt = Date.now();
    this.seqs.reset();
    const topics = [...this.listeners.keys()];
    if (topics.length) this.send({ subscribe: topics });
    this.ping();
    // Of a connection that was stopped and did not end before this one began.
    clearInterval(this.pulse);
    this.pulse = setInterval(() => this.ping(), PING_MS);
    this.events.onOpen(isAgain);
  }

  private closed(socket: WebSocket, code: number): void {
    if (socket !== this.socket) return;
    this.socket = null;
    clearInterval(this.pulse);
    this.pings.clear();
    this.events.onClose(code);
    if (!this.isWanted) return;
    // Whoever is signed out stops it. Who is not has another session by now, as after a new password.
    const isOut = code === NOT_SIGNED_IN;
    const wait = isOut ? SIGNED_OUT_MS : backOff(this.attempt, Math.random());
    this.retry = setTimeout(() => this.open(), wait);
    this.attempt += 1;
  }

  private ping(): void {
    if (Date.now() - this.heardAt > SILENT_MS) {
      const silent = this.socket;
      if (silent) this.closed(silent, 4000);
      silent?.close();
      return;
    }
    this.pingCount += 1;
    this.pings.set(this.pingCount, performance.now());
    this.send({ ping: this.pingCount });
  }

  private send(frame: object): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(frame));
  }

  private heard(text: string): void {
    this.heardAt = Date.now();
    const frame = JSON.parse(text) as Partial<Message> & { pong?: number };
    if (typeof frame.pong === "number") {
      const sent = this.pings.get(frame.pong);
      this.pings.delete(frame.pong);
      if (sent !== undefined) this.events.onLatency(performance.now() - sent);
      return;
    }
    if (typeof frame.topic !== "string" || typeof frame.seq !== "number") return;
    const verdict = this.seqs.see(frame.topic, frame.seq);
    if (verdict === "old") return;
    if (verdict === "gap") this.events.onGap(frame.topic);
    const message = frame as Message;
    for (const listener of this.listeners.get(frame.topic) ?? []) listener(message);
  }
}
