// A WebSocket that is opened again whenever it is lost, until the server refuses it for good.

import { encode } from "@msgpack/msgpack";

import { apiUrl } from "./api.ts";
import { nowMs } from "./clock.ts";
import { CLOSE_NOT_FOUND, CLOSE_UNAUTHORIZED, CLOSE_WRONG_PROTOCOL, HEARTBEAT_SECONDS, SUBPROTOCOL } from "./wire.ts";

const FIRST_RETRY_MS = 250;
const LONGEST_RETRY_MS = 4000;

/** The address of a socket under the API, beside the page. */
export function socketUrl(base: string, path: string, query: Record<string, string>): string {
  const url = apiUrl(base, path);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  for (const [name, value] of Object.entries(query)) url.searchParams.set(name, value);
  return url.href;
}

/** What a close of the connection means, in words; `final` where trying again cannot help. */
export function explain(code: number, reason: string): { reason: string; final: boolean } {
  switch (code) {
    case CLOSE_UNAUTHORIZED:
      return { reason: reason || "The server wants a token: add ?token=… to this page's address.", final: true };
    case CLOSE_WRONG_PROTOCOL:
      return { reason: reason || `The server does not speak ${SUBPROTOCOL}: reload this page.`, final: true };
    case CLOSE_NOT_FOUND:
      return { reason: reason || "The server has nothing of this name.", final: false };
    default:
      return { reason: reason || "The server does not answer.", final: false };
  }
}

export class Connection {
  /** Why the connection is refused or lost, in words. */
  problem = "";
  /** Trying again cannot help. */
  refused = false;

  private socket: WebSocket | null = null;
  private url: (() => string) | null = null;
  /** What the server said when it refused this connection. */
  private refusal = "";
  private retryDelayMs = FIRST_RETRY_MS;
  private retryAtMs: number | null = null;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private silenceTimer: ReturnType<typeof setTimeout> | undefined;
  private heartbeatMs = 1000 * HEARTBEAT_SECONDS;

  constructor(
    private readonly receive: (data: ArrayBuffer, receivedMs: number) => void,
    /** A connection is begun. */
    private readonly begun: () => void = () => undefined,
  ) {}

  /** Connect to the address, which is asked for anew with each attempt; an earlier connection ends. */
  open(url: () => string): void {
    this.url = url;
    this.problem = "";
    this.connect();
  }

  close(): void {
    this.disconnect();
    this.url = null;
  }

  /** Try again now. */
  retry(): void {
    if (this.url !== null) this.connect();
  }

  /** The server has greeted: it works. */
  established(heartbeatSeconds: number): void {
    this.retryDelayMs = FIRST_RETRY_MS;
    this.problem = "";
    this.heartbeatMs = 1000 * heartbeatSeconds;
  }

  /** The server says why it is going to close. */
  refuse(reason: string): void {
    this.refusal = reason;
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  get isRetrying(): boolean {
    return this.retryAtMs !== null;
  }

  /** Seconds until the next attempt to connect. */
  retrySeconds(timeMs: number): number {
    return this.retryAtMs === null ? 0 : Math.max(0, (this.retryAtMs - timeMs) / 1000);
  }

  send(message: object): void {
    if (this.isOpen) this.socket!.send(encode(message));
  }

  private connect(): void {
    this.disconnect();
    this.refused = false;
    this.refusal = "";
    this.begun();
    const socket = new WebSocket(this.url!(), SUBPROTOCOL);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      this.expectMessage();
      this.receive(event.data, nowMs());
    };
    socket.onclose = (event) => this.closed(event);
    this.socket = socket;
    this.expectMessage();
  }

  private disconnect(): void {
    clearTimeout(this.retryTimer);
    clearTimeout(this.silenceTimer);
    this.retryAtMs = null;
    if (this.socket === null) return;
    const { socket } = this;
    socket.onmessage = socket.onclose = null;
    // Browsers complain of a connection that is closed before it stands.
    if (socket.readyState === WebSocket.CONNECTING) socket.onopen = () => socket.close();
    else socket.close();
    this.socket = null;
  }

  private closed(event: CloseEvent): void {
    clearTimeout(this.silenceTimer);
    this.socket = null;
    const { reason, final } = explain(event.code, this.refusal || event.reason);
    this.problem = reason;
    if (final) this.refused = true;
    else this.scheduleRetry();
  }

  private scheduleRetry(): void {
    const delay = this.retryDelayMs * (0.8 + 0.4 * Math.random());
    this.retryDelayMs = Math.min(LONGEST_RETRY_MS, 1.6 * this.retryDelayMs);
    this.retryAtMs = nowMs() + delay;
    this.retryTimer = setTimeout(() => this.connect(), delay);
  }

  /** Give the connection up when nothing, not even a heartbeat, comes for three heartbeats. */
  private expectMessage(): void {
    clearTimeout(this.silenceTimer);
    this.silenceTimer = setTimeout(() => {
      this.disconnect();
      this.problem = "The connection went silent.";
      this.scheduleRetry();
    }, 3 * this.heartbeatMs);
  }
}
