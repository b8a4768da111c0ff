// What the panel shows: signals that change at most four times a second. The viewport does not wait for them.

import { batch, effect, signal } from "@preact/signals";

import { words } from "./api.ts";
import { nowMs } from "./clock.ts";
import type { GridState } from "./grid/info.ts";
import type { Modulation } from "./grid/modulate.ts";
import { LiveStream, type ConnectionState } from "./live.ts";
import { LiveField } from "./livefield.ts";
import type { Sample } from "./rate.ts";
import { listFields, listStreams, type FieldDescription, type StreamDescription, type StreamSummary } from "./rest.ts";
import type { Vector3 } from "./sh.ts";
import { TimeTravel } from "./time.ts";
import { OWN_OBJECTS, change, view } from "./view.ts";
import type { Near, ShownCamera, Viewport } from "./viewport.ts";
import type { FieldMember, Frame, StreamInfo, StreamStatus } from "./wire.ts";

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
  grid: GridState;
  /** Radius of the object with what it stands on, metres; 0 before there is one. */
  objectRadius: number;
  modulation: Modulation | null;
  /** The object beside the probes that light it, where it is. */
  near: Near | null;
  field: FieldSnapshot;
}

/** The subscription of a field. */
export interface FieldSnapshot {
  state: ConnectionState;
  problem: string;
  members: readonly FieldMember[];
  /** Frames received each second, of all its streams. */
  fps: number;
  missed: number;
}

export const live = new LiveStream(document.baseURI, true);
export const liveField = new LiveField(document.baseURI);
export const streams = signal<StreamDescription[] | null>(null);
/** Why the list of streams cannot be had, in words. */
export const streamsProblem = signal("");
/** Several streams whose light is combined; `null` until they are known. */
export const fields = signal<FieldDescription[] | null>(null);
/** Why the list of fields cannot be had, in words. */
export const fieldsProblem = signal("");
/** Why the object that was asked for cannot be shown, in words. */
export const objectProblem = signal("");
/** Whether an object is being fetched. */
export const objectIsComing = signal(false);
export const snapshot = signal<Snapshot | null>(null);
/** Asks for the picture's camera as it is now; `null` before there is a picture. */
export const shownCamera = signal<(() => ShownCamera) | null>(null);

/** Follow the chosen stream, grid and object, and keep the signals fresh. */
export function startSession(viewport: Viewport, time: TimeTravel): void {
  let followed: string | null = null;
  shownCamera.value = () => viewport.shownCamera;
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
      time.follow(nowMs());
    }
  });
  followGrid(viewport);
  followField();
  followObject(viewport);
  const update = () => {
    time.refresh(nowMs());
    refresh(viewport);
  };
  setInterval(update, REFRESH_MS);
  update();
  void pollStreams();
}

function followGrid(viewport: Viewport): void {
  let shown = "";
  effect(() => {
    const { grid, groups } = view.value;
    const ids = grid === null ? [] : [grid, ...groups.filter((id) => id !== grid)];
    if (ids.join() === shown) return;
    shown = ids.join();
    // What is wrong stands in `viewport.gridState`, which the panel reads.
    viewport.showGrids(ids).catch(() => undefined);
  });
  effect(() => {
    viewport.standProbe(probeStands());
  });
}

/** Where the settings of the chosen stream say that its probe stands, world metres; `null`: they do not. */
export function probeStands(): Vector3 | null {
  const settings = streams.value?.find(({ name }) => name === view.value.stream)?.settings;
  return (settings?.["position_m"] ?? null) as Vector3 | null;
}

function followField(): void {
  effect(() => {
    const { light, field } = view.value;
    const first = fields.value?.[0]?.name;
    if (light === "field" && field === null && first !== undefined) change({ field: first });
    liveField.follow(light === "field" ? field : null);
  });
}

function followObject(viewport: Viewport): void {
  let shown = "";
  effect(() => {
    const { object } = view.value;
    if (object === shown) return;
    shown = object;
    objectProblem.value = "";
    objectIsComing.value = false;
    if ((OWN_OBJECTS as readonly string[]).includes(object)) return;
    objectIsComing.value = true;
    viewport
      .showTransfer(object)
      .catch((error: unknown) => {
        if (shown === object) objectProblem.value = words(error);
      })
      .finally(() => {
        if (shown === object) objectIsComing.value = false;
      });
  });
}

export function chooseStream(name: string): void {
  const isField = view.peek().light === "field";
  change({ stream: name, ev: null, ...(isField ? { light: "stream", at: null, camera: null } : {}) });
}

/** The first stream that runs, else the first. */
export function preferred(candidates: readonly StreamSummary[]): string | null {
  return (candidates.find(({ state }) => state === "running") ?? candidates[0])?.name ?? null;
}

async function pollStreams(): Promise<void> {
  await refreshStreams();
  setTimeout(() => void pollStreams(), STREAMS_MS);
}

/** Read the lists of streams and fields now. */
export async function refreshStreams(): Promise<void> {
  await Promise.all([readStreams(), readFields()]);
}

async function readFields(): Promise<void> {
  try {
    const list = await listFields();
    batch(() => {
      fields.value = list;
      fieldsProblem.value = "";
    });
  } catch (error) {
    fieldsProblem.value = words(error);
  }
}

async function readStreams(): Promise<void> {
  try {
    const list = await listStreams();
    batch(() => {
      streams.value = list;
      streamsProblem.value = "";
    });
  } catch (error) {
    streamsProblem.value = words(error);
  }
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
    grid: viewport.gridState,
    objectRadius: viewport.objectRadius,
    modulation: viewport.modulation,
    near: viewport.near,
    field: {
      state: liveField.state,
      problem: liveField.problem,
      members: liveField.members,
      fps: liveField.frames.perSecond(timeMs),
      missed: liveField.missed,
    },
  };
}
