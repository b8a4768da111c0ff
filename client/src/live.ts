// A live subscription: connects, decodes, reconnects. The message handler only stores what is newest; the viewport and
// the panel come and look at their own pace.

import { decode } from "@msgpack/msgpack";

import { ClockOffset } from "./clock.ts";
import { Connection, socketUrl } from "./connection.ts";
import { unpackGradients } from "./gradients/extrapolate.ts";
import { History, Rate } from "./rate.ts";
import { PAGE_BANDS, unpackCoefficients } from "./sh.ts";
import type { Backdrop, Frame, LiveMessage, StreamInfo, StreamStatus, Subscribe } from "./wire.ts";

export const HISTORY_MS = 30_000;
/** Frames of the past that are kept at most, however fast they come. */
const MOST_PAST = 3000;
/** Pictures are large: of the past, few are kept. */
const PICTURE_PAUSE_MS = 500;
const STALLED_MS = 2000;

export type ConnectionState = "idle" | "connecting" | "waiting" | "live" | "stalled" | "retrying" | "refused";

export interface Light {
  frame: Frame;
  coefficients: Float32Array;
  /** `(bands², 3, 3)` per metre; `null`: the frame has none. */
  gradients: Float32Array | null;
  /** When it arrived, this machine's clock. */
  receivedMs: number;
}

export interface PastPicture {
  receivedMs: number;
  picture: Backdrop;
}

/** Where the subscription of a stream lives, beside the page. */
export function liveUrl(base: string, stream: string, backdrop: boolean, gradients: boolean): string {
  const query = { bands: String(PAGE_BANDS), backdrop: String(backdrop), ...(gradients ? { gradients: "true" } : {}) };
  return socketUrl(base, `streams/${encodeURIComponent(stream)}/live`, query);
}

/** The light of a frame that arrived at a time of this machine's clock. */
export function lightOf(frame: Frame, receivedMs: number): Light {
  const coefficients = unpackCoefficients(frame.coefficients);
  const gradients = frame.gradients ? unpackGradients(frame.gradients, coefficients.length) : null;
  return { frame, coefficients, gradients, receivedMs };
}

/** Whether two lights look the same, whenever they came: then there is nothing to draw. */
export function looksTheSame(a: Light, b: Light): boolean {
  return (
    sameNumbers(a.coefficients, b.coefficients) &&
    sameNumbers(a.gradients, b.gradients) &&
    placeAndDirection(a) === placeAndDirection(b)
  );
}

function sameNumbers(a: Float32Array | null, b: Float32Array | null): boolean {
  if (a === null || b === null) return a === b;
  return a.length === b.length && a.every((value, k) => value === b[k]);
}

const placeAndDirection = ({ frame: { position, trust_radius_m, dominant } }: Light): string =>
  JSON.stringify([position, trust_radius_m, dominant]);

export class LiveStream {
  /** The newest light; it stays when the connection goes. */
  light: Light | null = null;
  /** The newest picture that nobody has taken yet. */
  backdrop: Backdrop | null = null;
  info: StreamInfo | null = null;
  status: StreamStatus | null = null;
  /** Frames that the server overtook for this page, over all its connections. */
  missed = 0;
  /** The light of the last `HISTORY_MS`, oldest first. Replaced as it changes: what was read stays as it was. */
  past: readonly Light[] = [];
  /** Pictures of the same time, oldest first. */
  pastPictures: readonly PastPicture[] = [];
  readonly frames = new Rate();
  readonly latencies = new History(HISTORY_MS);
  readonly clock: ClockOffset;

  private stream: string | null = null;
  private wantsBackdrop = true;
  private lastFrameMs = 0;
  private missedOnConnection = 0;
  private readonly connection = new Connection(
    (data, receivedMs) => this.receive(data, receivedMs),
    () => (this.missedOnConnection = 0),
  );
  /** Light that has arrived since the past was brought up to date. */
  private coming: Light[] = [];

  constructor(
    private readonly base: string,
    /** Whether to ask for gradients. */
    private readonly gradients = false,
  ) {
    this.clock = new ClockOffset(new URL(base).hostname);
  }

  /** Follow this stream from now on; what was known of another one is forgotten. */
  follow(stream: string): void {
    if (stream === this.stream && !this.connection.refused) return;
    this.stream = stream;
    this.light = this.backdrop = this.info = this.status = null;
    this.missed = 0;
    this.past = this.pastPictures = [];
    this.coming = [];
    this.latencies.clear();
    this.frames.clear();
    this.lastFrameMs = 0;
    this.connection.open(() => liveUrl(this.base, stream, this.wantsBackdrop, this.gradients));
  }

  /** Follow nothing any more. */
  close(): void {
    this.connection.close();
    this.stream = null;
  }

  /** Why the connection is refused or lost, in words. */
  get problem(): string {
    return this.connection.problem;
  }

  /** Ask for pictures of the surroundings, or spare the bandwidth. */
  setBackdrop(wanted: boolean): void {
    if (wanted === this.wantsBackdrop) return;
    this.wantsBackdrop = wanted;
    const message: Subscribe = { type: "subscribe", backdrop: wanted };
    this.connection.send(message);
  }

  /** Try again now. */
  retry(): void {
    this.connection.retry();
  }

  state(timeMs: number): ConnectionState {
    if (this.stream === null) return "idle";
    if (this.connection.refused) return "refused";
    if (this.connection.isRetrying) return "retrying";
    if (!this.connection.isOpen) return "connecting";
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
    return this.connection.retrySeconds(timeMs);
  }

  private receive(data: ArrayBuffer, receivedMs: number): void {
    const message = decode(new Uint8Array(data)) as LiveMessage;
    switch (message.type) {
      case "hello":
        this.connection.established(message.heartbeat_seconds);
        this.info = message.stream;
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
        this.connection.refuse(message.reason);
        break;
    }
  }

  private take(frame: Frame, receivedMs: number): void {
    this.light = lightOf(frame, receivedMs);
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
}
