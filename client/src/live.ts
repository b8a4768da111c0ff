// A live subscription: connects, decodes, reconnects. The message handler only stores what is newest; the viewport and
// the panel come and look at their own pace.

import { decode, encode } from "@msgpack/msgpack";

import { apiUrl } from "./api.ts";
import { ClockOffset, nowMs } from "./clock.ts";
import { History, Rate } from "./rate.ts";
import { PAGE_BANDS, unpackCoefficients } from "./sh.ts";
import {
  CLOSE_NOT_FOUND,
  CLOSE_UNAUTHORIZED,
  CLOSE_WRONG_PROTOCOL,
  HEARTBEAT_SECONDS,
  SUBPROTOCOL,
  type Backdrop,
  type Frame,
  type LiveMessage,
  type StreamInfo,
  type StreamStatus,
  type Subscribe,
} from "./wire.ts";

export const HISTORY_MS = 30_000;
/** Frames of the past that are kept at most, however fast they come. */
const MOST_PAST = 3000;
/** Pictures are large: of the past, few are kept. */
const PICTURE_PAUSE_MS = 500;
const STALLED_MS = 2000;
const FIRST_RETRY_MS = 250;
const LONGEST_RETRY_MS = 4000;

export type ConnectionState = "idle" | "connecting" | "waiting" | "live" | "stalled" | "retrying" | "refused";

export interface Light {
  frame: Frame;
  coefficients: Float32Array;
  /** When it arrived, this machine's clock. */
  receivedMs: number;
}

export interface PastPicture {
  receivedMs: number;
  picture: Backdrop;
}

/** Where the subscription of a stream lives, beside the page. */
export function liveUrl(base: string, stream: string, backdrop: boolean): string {
  const url = apiUrl(base, `streams/${encodeURIComponent(stream)}/live`);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  url.searchParams.set("bands", String(PAGE_BANDS));
  url.searchParams.set("backdrop", String(backdrop));
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
      return { reason: reason || "The server has no such stream.", final: false };
    default:
      return { reason: reason || "The server does not answer.", final: false };
  }
}

export class LiveStream {
  /** The newest light; it stays when the connection goes. */
  light: Light | null = null;
  /** The newest picture that nobody has taken yet. */
  backdrop: Backdrop | null = null;
  info: StreamInfo | null = null;
  status: StreamStatus | null = null;
  /** Frames that the server overtook for this page, over all its connections. */
  missed = 0;
  /** Why the connection is refused or lost, in words. */
  problem = "";
  /** The light of the last `HISTORY_MS`, oldest first. Replaced as it changes: what was read stays as it was. */
  past: readonly Light[] = [];
  /** Pictures of the same time, oldest first. */
  pastPictures: readonly PastPicture[] = [];
  readonly frames = new Rate();
  readonly latencies = new History(HISTORY_MS);
  readonly clock: ClockOffset;

  private socket: WebSocket | null = null;
  private stream: string | null = null;
  private wantsBackdrop = true;
  private refused = false;
  /** What the server said when it refused this connection. */
  private refusal = "";
  private retryDelayMs = FIRST_RETRY_MS;
  private retryAtMs: number | null = null;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private silenceTimer: ReturnType<typeof setTimeout> | undefined;
  private heartbeatMs = 1000 * HEARTBEAT_SECONDS;
  private lastFrameMs = 0;
  private missedOnConnection = 0;
  /** Light that has arrived since the past was brought up to date. */
  private coming: Light[] = [];

  constructor(private readonly base: string) {
    this.clock = new ClockOffset(new URL(base).hostname);
  }

  /** Follow this stream from now on; what was known of another one is forgotten. */
  follow(stream: string): void {
    if (stream === this.stream && !this.refused) return;
    this.stream = stream;
    this.light = this.backdrop = this.info = this.status = null;
    this.missed = 0;
    this.problem = "";
    this.past = this.pastPictures = [];
    this.coming = [];
    this.latencies.clear();
    this.frames.clear();
    this.lastFrameMs = 0;
    this.connect();
  }

  /** Follow nothing any more. */
  close(): void {
    this.disconnect();
    this.stream = null;
  }

  /** Ask for pictures of the surroundings, or spare the bandwidth. */
  setBackdrop(wanted: boolean): void {
    if (wanted === this.wantsBackdrop) return;
    this.wantsBackdrop = wanted;
    this.send({ type: "subscribe", backdrop: wanted });
  }

  /** Try again now. */
  retry(): void {
    if (this.stream !== null) this.connect();
  }

  state(timeMs: number): ConnectionState {
    if (this.stream === null) return "idle";
    if (this.refused) return "refused";
    if (this.retryAtMs !== null) return "retrying";
    if (this.socket?.readyState !== WebSocket.OPEN) return "connecting";
    if (this.light === null) return "waiting";
    const silent = timeMs - this.lastFrameMs > STALLED_MS;
    return silent || (this.status !== null && this.status.state !== "running") ? "stalled" : "live";
  }

  /** Seconds since the last frame arrived. */
  silentSeconds(timeMs: number): number {
    return this.lastFrameMs === 0 ? 0 : (timeMs - this.lastFrameMs) / 1000;
  }

  /** Seconds until the next attempt to connect. */
  retrySeconds(timeMs: number): number {
    return this.retryAtMs === null ? 0 : Math.max(0, (this.retryAtMs - timeMs) / 1000);
  }

  private connect(): void {
    this.disconnect();
    this.refused = false;
    this.refusal = "";
    this.missedOnConnection = 0;
    const socket = new WebSocket(liveUrl(this.base, this.stream!, this.wantsBackdrop), SUBPROTOCOL);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => this.receive(event.data);
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

  private receive(data: ArrayBuffer): void {
    const receivedMs = nowMs();
    this.expectMessage();
    const message = decode(new Uint8Array(data)) as LiveMessage;
    switch (message.type) {
      case "hello":
        this.retryDelayMs = FIRST_RETRY_MS;
        this.problem = "";
        this.info = message.stream;
        this.heartbeatMs = 1000 * message.heartbeat_seconds;
        this.clock.observe(message.server_time_ns, receivedMs);
        // The newest frame of the past: its light is wanted, its latency means nothing.
        if (message.latest !== null) this.take(message.latest, receivedMs);
        break;
      case "frame":
        this.take(message, receivedMs);
        this.frames.add(receivedMs);
        this.latencies.add({
          timeMs: receivedMs,
          value: receivedMs - this.clock.ms - message.capture_time_ns / 1e6,
        });
        break;
      case "backdrop":
        this.backdrop = message;
        this.keepPicture(message, receivedMs);
        break;
      case "missed":
        this.missed += message.total - this.missedOnConnection;
        this.missedOnConnection = message.total;
        break;
      case "heartbeat":
        this.clock.observe(message.server_time_ns, receivedMs);
        break;
      case "status":
        this.status = message;
        break;
      case "refused":
        this.refusal = message.reason;
        break;
    }
  }

  private take(frame: Frame, receivedMs: number): void {
    this.light = { frame, coefficients: unpackCoefficients(frame.coefficients), receivedMs };
    this.lastFrameMs = receivedMs;
    this.coming.push(this.light);
  }

  /** Take what has arrived into the past; called by whoever shows it, at its own pace. */
  updatePast(timeMs: number): void {
    if (this.coming.length === 0 && (this.past[0]?.receivedMs ?? Infinity) > timeMs - HISTORY_MS) return;
    const all = [...this.past, ...this.coming].filter(({ receivedMs }) => receivedMs > timeMs - HISTORY_MS);
    this.past = all.slice(-MOST_PAST);
    this.coming = [];
  }

  private keepPicture(picture: Backdrop, receivedMs: number): void {
    if (receivedMs - (this.pastPictures.at(-1)?.receivedMs ?? -Infinity) < PICTURE_PAUSE_MS) return;
    const kept = this.pastPictures.filter((item) => item.receivedMs > receivedMs - HISTORY_MS);
    this.pastPictures = [...kept, { receivedMs, picture }];
  }

  private send(message: Subscribe): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(encode(message));
  }
}
