// Generated from core/lightwell/wire.py by `python -m lightwell_server.typescript`. Do not edit.

export const SUBPROTOCOL = "lightwell.v1";
export const HEARTBEAT_SECONDS = 2.0;
export const CLOSE_WRONG_PROTOCOL = 1002;
export const CLOSE_POLICY = 1008;
export const CLOSE_NOT_FOUND = 4404;
export const CLOSE_UNAUTHORIZED = 4401;
export const CLOSE_REPLACED = 4409;

export type Convention = "lightwell" | "three" | "filament" | "unity" | "unreal" | "sloan";

/** What a subscriber learns about a stream when it connects. */
export interface StreamInfo {
  name: string;
  source: string;
  mapping: string;
  bands: number;
  units: "W.sr-1.m-2" | "relative";
  state: "ended" | "failed" | "running" | "stalled" | "starting" | "stopped";
  convention: Convention;
  backdrop: boolean;
  /** Whether its frames have gradients for who asks for them. */
  gradients: boolean;
}

/** The window that has been applied to the coefficients (MATHS §4): `c'_lm = weights[l] c_lm`. */
export interface WindowUsed {
  kind: string;
  weights: number[];
  /** λ of `1/(1 + λ l²(l+1)²)` that the automatic search chose; 0 for fixed windows and where none was needed. */
  strength: number;
}

/** The split into one distant light and ambient light (MATHS §11a), in the frame's convention axes. */
export interface DominantLight {
  /** Unit vector towards the light. */
  direction: [number, number, number];
  /** RGB irradiance on a surface that faces the light. */
  irradiance: [number, number, number];
  /** RGB radiance of the constant remainder. */
  ambient: [number, number, number];
}

/** What happened to one frame on its way: says how far its light can be trusted. */
export interface Quality {
  /** Samples that were NaN; taken as 0. */
  nan: number;
  /** Samples that were infinite; +Inf is taken as 65504 (the largest half), −Inf as 0. */
  infinite: number;
  /** Samples below zero; kept, unless the stream clamps them. */
  negative: number;
  /** Samples at or above the level at which the source clips. */
  saturated: number;
  /** Share of the sphere that the probe does not see. */
  blind_fraction: number;
  /** True where the temporal filter started anew at this frame. */
  cut: boolean;
  /** Milliseconds spent in each stage. */
  stage_ms: Record<string, number>;
}

/** SH coefficients of one captured frame. */
export interface Frame {
  type: "frame";
  stream: string;
  /** Names one run of the ingest worker: `seq` starts anew with each. */
  session: string;
  /** Counts published frames from 0. A gap means that frames were lost between worker and server. */
  seq: number;
  capture_time_ns: number;
  /** When the worker had the whole frame. */
  ingest_time_ns: number;
  /** When the worker handed it to its socket. */
  publish_time_ns: number;
  bands: number;
  /** Little-endian float32, `(bands², 3)`, coefficient-major: R, G, B of coefficient 0 first. */
  coefficients: Uint8Array;
  convention: Convention;
  units: "W.sr-1.m-2" | "relative";
  window: WindowUsed;
  /** Where the probe stood, metres, in the frame's convention axes; nil where that is not known. */
  position: [number, number, number] | null;
  /** Little-endian float32, `(bands², 3, 3)`: coefficient, channel, ∂/∂(x, y, z) per metre; only where asked for. */
  gradients: Uint8Array | null;
  /** How far from the probe coefficients and gradients together are within about ten per cent, metres (MATHS §7.4). */
  trust_radius_m: number | null;
  dominant: DominantLight | null;
  quality: Quality;
  /** What the source calls this frame: a file name, a frame number. */
  source_frame: string;
  /** Exact coefficients, as `coefficients`, where the source knows them (synthetic rooms). */
  truth: Uint8Array | null;
}

/** First message to a subscriber. */
export interface Hello {
  type: "hello";
  protocol: string;
  server_version: string;
  /** Names one run of the server. */
  server_session: string;
  stream: StreamInfo;
  server_time_ns: number;
  heartbeat_seconds: number;
  latest: Frame | null;
}

/** `count` frames were overtaken by newer ones before this subscriber took them (`max_fps` does not count). */
export interface Missed {
  type: "missed";
  stream: string;
  count: number;
  /** Missed by this subscription so far. */
  total: number;
}

/**
 * A lat-long picture of the surroundings, log-encoded in a JPEG.
 *
 * Sample `y = log2(1 + k x) / log2(1 + k cap)` in 0 … 1, quantised to 8 bits; so `x = ((1 + k cap)^y − 1) / k`.
 * Row 0 is +Z, columns as in `lightwell.conventions`; values above `cap` are clipped (the light comes from the
 * coefficients).
 */
export interface Backdrop {
  type: "backdrop";
  stream: string;
  session: string;
  seq: number;
  capture_time_ns: number;
  width: number;
  height: number;
  k: number;
  cap: number;
  jpeg: Uint8Array;
}

/** Proves that the connection lives while no frame comes. */
export interface Heartbeat {
  type: "heartbeat";
  server_time_ns: number;
}

/** State and counters of a source, sent by the worker once a second and at each change of state. */
export interface StreamStatus {
  type: "status";
  stream: string;
  session: string;
  state: "ended" | "failed" | "running" | "stalled" | "starting" | "stopped";
  fps: number;
  /** Time between the source's frames, as far as it knows; 0 where it does not. */
  interval_seconds: number;
  frames_in: number;
  frames_published: number;
  /** Frames that could not be read. */
  frames_skipped: number;
  /** Frames that were overtaken by a newer one before they were processed or sent. */
  frames_dropped: number;
  nan_samples: number;
  infinite_samples: number;
  negative_samples: number;
  reconnects: number;
  last_error: string;
  last_frame_time_ns: number;
  /** Moving average of the milliseconds that each stage takes. */
  stage_ms: Record<string, number>;
}

/** The server does not accept this connection or message, and why. */
export interface Refused {
  type: "refused";
  reason: string;
}

/** One stream of a field. */
export interface FieldMember {
  stream: string;
  /** The stream's state; `unknown` where there is no stream of that name now. */
  state: "ended" | "failed" | "running" | "stalled" | "starting" | "stopped" | "unknown";
  /** Why its light is not in the field now, and the remedy; empty where it is. */
  problem: string;
}

/** First message of a field's socket. */
export interface FieldHello {
  type: "field_hello";
  protocol: string;
  server_version: string;
  server_session: string;
  server_time_ns: number;
  heartbeat_seconds: number;
  field: string;
  convention: Convention;
  members: FieldMember[];
}

/** Which members of a field give light, whenever that changes; the others are to be left out. */
export interface FieldStatus {
  type: "field_status";
  field: string;
  members: FieldMember[];
}

/**
 * Change a subscription; what is left out stays as it is.
 *
 * So `max_fps` can be changed and not be taken away: for frames without a limit, connect again.
 */
export interface Subscribe {
  type: "subscribe";
  bands?: number | null;
  max_fps?: number | null;
  convention?: Convention | null;
  backdrop?: boolean | null;
  gradients?: boolean | null;
}

/** What a subscriber may receive. */
export type LiveMessage = Hello | Frame | Missed | Backdrop | Heartbeat | StreamStatus | Refused;

/** What a field's socket may receive. */
export type FieldMessage = FieldHello | Frame | Missed | FieldStatus | Heartbeat | Refused;
