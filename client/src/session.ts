// What the panel shows: signals that change at most four times a second. The viewport does not wait for them.

import { batch, effect, signal } from "@preact/signals";

import { listStreams, type StreamDescription, type StreamSummary } from "./rest.ts";
import { nowMs } from "./clock.ts";
import { LiveStream, type ConnectionState } from "./live.ts";
import type { Sample } from "./rate.ts";
import { change, view } from "./view.ts";
import type { Viewport } from "./viewport.ts";
import type { Frame, StreamInfo, StreamStatus } from "./wire.ts";

const REFRESH_MS = 250;
const STREAMS_MS = 3000;

export interface Snapshot {
  state: ConnectionState;
  problem: string;
  retrySeconds: number;
  silentSeconds: number;
  renderFps: number;
  streamFps: number;
  latencyMs: number | null;
  missed: number;
  latencyLabel: string;
  latencies: readonly Sample[];
  timeMs: number;
  info: StreamInfo | null;
  status: StreamStatus | null;
  frame: Frame | null;
  coefficients: Float32Array | null;
  meteredEv: number;
}

export const live = new LiveStream(document.baseURI);
export const streams = signal<StreamDescription[] | null>(null);
/** Why the list of streams cannot be had, in words. */
export const streamsProblem = signal("");
export const paused = signal(false);
export const snapshot = signal<Snapshot | null>(null);

/** Follow the chosen stream and keep the signals fresh. */
export function startSession(viewport: Viewport): void {
  let followed: string | null = null;
  effect(() => {
    const { stream } = view.value;
    if (stream === null) {
      // Once picked, the stream stands in the address: it does not change when another one starts.
      const name = preferred(streams.value ?? []);
      if (name !== null) change({ stream: name });
    } else if (stream !== followed) {
      followed = stream;
      live.follow(stream);
      viewport.clear();
      paused.value = false;
    }
  });
  effect(() => {
    viewport.paused = paused.value;
  });
  setInterval(() => refresh(viewport), REFRESH_MS);
  refresh(viewport);
  void pollStreams();
}

export function chooseStream(name: string): void {
  change({ stream: name, ev: null });
}

/** The first stream that runs, else the first. */
export function preferred(candidates: readonly StreamSummary[]): string | null {
  return (candidates.find(({ state }) => state === "running") ?? candidates[0])?.name ?? null;
}

async function pollStreams(): Promise<void> {
  try {
    const list = await listStreams();
    batch(() => {
      streams.value = list;
      streamsProblem.value = "";
    });
  } catch (error) {
    streamsProblem.value = (error as Error).message;
  }
  setTimeout(() => void pollStreams(), STREAMS_MS);
}

function refresh(viewport: Viewport): void {
  const timeMs = nowMs();
  const shown = viewport.shown;
  snapshot.value = {
    state: live.state(timeMs),
    problem: live.problem,
    retrySeconds: live.retrySeconds(timeMs),
    silentSeconds: live.silentSeconds(timeMs),
    renderFps: viewport.drawn.perSecond(timeMs),
    streamFps: live.frames.perSecond(timeMs),
    latencyMs: live.latencies.quantile(0.5, timeMs - 2000),
    missed: live.missed,
    latencyLabel: live.clock.label,
    latencies: live.latencies.all(),
    timeMs,
    info: live.info,
    status: live.status,
    frame: shown?.frame ?? null,
    coefficients: shown?.coefficients ?? null,
    meteredEv: viewport.meteredEv,
  };
}
