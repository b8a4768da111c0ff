// The resources of the REST interface that the page uses, and their shapes. `openapi.json` describes all of them.

import { ask, send } from "./api.ts";

export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
export type JsonObject = { [key: string]: Json };

export interface StreamSummary {
  name: string;
  state: string;
}

export interface StreamDescription extends StreamSummary {
  /** `file`: of the configuration; `api`: made here; `worker`: announced by a worker started elsewhere. */
  origin: "file" | "api" | "worker";
  settings: JsonObject & { source: string; enabled: boolean };
  fps: number;
  subscribers: number;
  frames_received: number;
  frames_skipped: number;
  frames_dropped: number;
  last_frame_age_seconds: number | null;
  last_error: string;
  worker: { state: string; restarts: number; last_error: string } | null;
}

const LIST_TIMEOUT_MS = 5000;

export async function listStreams(): Promise<StreamDescription[]> {
  return (await ask<{ streams: StreamDescription[] }>("streams", { timeoutMs: LIST_TIMEOUT_MS })).streams;
}

/** A stream and the ETag of its settings. */
export async function getStream(name: string): Promise<{ stream: StreamDescription; etag: string }> {
  const response = await send(`streams/${encodeURIComponent(name)}`);
  return { stream: (await response.json()) as StreamDescription, etag: response.headers.get("ETag") ?? "*" };
}

export function createStream(name: string, settings: JsonObject): Promise<StreamDescription> {
  return ask("streams", { method: "POST", body: { name, settings } });
}

/** Change what `patch` names (JSON merge patch), unless somebody else has changed the stream meanwhile. */
export function changeStream(name: string, patch: JsonObject, etag: string): Promise<StreamDescription> {
  return ask(`streams/${encodeURIComponent(name)}`, { method: "PATCH", body: patch, headers: { "If-Match": etag } });
}

export async function deleteStream(name: string): Promise<void> {
  await send(`streams/${encodeURIComponent(name)}`, { method: "DELETE" });
}

/** One stream of a field. */
export interface FieldMemberDescription {
  stream: string;
  state: string;
  used: boolean;
  /** Why it is not used, and the remedy; empty where it is. */
  problem: string;
  position_m: [number, number, number] | null;
  gradients: boolean;
  trust_radius_m: number | null;
}

/** Streams whose probes stand at known places: the light between them. */
export interface FieldDescription {
  name: string;
  origin: "file" | "api";
  streams: string[];
  members: FieldMemberDescription[];
  subscribers: number;
}

export async function listFields(): Promise<FieldDescription[]> {
  return (await ask<{ fields: FieldDescription[] }>("fields", { timeoutMs: LIST_TIMEOUT_MS })).fields;
}

export function createField(name: string, streams: readonly string[]): Promise<FieldDescription> {
  return ask("fields", { method: "POST", body: { name, streams } });
}

export function changeField(name: string, streams: readonly string[]): Promise<FieldDescription> {
  return ask(`fields/${encodeURIComponent(name)}`, { method: "PATCH", body: { streams } });
}

export async function deleteField(name: string): Promise<void> {
  await send(`fields/${encodeURIComponent(name)}`, { method: "DELETE" });
}

export type JobState = "queued" | "running" | "cancelling" | "cancelled" | "failed" | "succeeded";

export interface Progress {
  stage: string;
  done: number;
  total: number;
  /** Units of `total` a second. */
  rate: number;
  eta_seconds: number | null;
}

export interface Artifact {
  id: string;
  path: string;
  bytes: number;
  sha256: string;
  media_type: string;
}

/** Times are nanoseconds since the Unix epoch. */
export interface Job {
  id: string;
  kind: string;
  state: JobState;
  /** Smaller is sooner; 100 where nothing was said. */
  priority: number;
  settings: JsonObject;
  progress: Progress | null;
  attempts: number;
  created: number;
  started: number | null;
  finished: number | null;
  artifacts: Artifact[];
  error: string | null;
  /** When the picture of what there is so far was drawn; `null`: there is none. */
  preview_ns: number | null;
}

export interface JobKind {
  name: string;
  description: string;
  settings_schema: JsonObject;
}

export interface Estimate {
  /** Core time. */
  seconds: number;
  memory_bytes: number;
  disk_bytes: number;
  fits: boolean;
  reason: string | null;
}

/** Jobs, newest first, and the cursor of those that follow. */
export interface JobPage {
  jobs: Job[];
  next: string | null;
}

export interface JobFilter {
  state?: string;
  kind?: string;
}

export const FINISHED: readonly JobState[] = ["cancelled", "failed", "succeeded"];

export function jobKinds(): Promise<JobKind[]> {
  return ask("job-kinds");
}

export function listJobs(query: JobFilter & { cursor?: string; limit?: number } = {}): Promise<JobPage> {
  const parameters = Object.entries(query).map(([name, value]) => `${name}=${encodeURIComponent(String(value))}`);
  return ask(`jobs?${parameters.join("&")}`);
}

export function getJob(id: string): Promise<Job> {
  return ask(`jobs/${id}`);
}

export interface Submission {
  /** Smaller is sooner. */
  priority?: number;
  /** The same key again gives the same job, and not another. */
  key?: string;
}

export function submitJob(kind: string, settings: JsonObject, { priority, key }: Submission = {}): Promise<Job> {
  return ask("jobs", {
    method: "POST",
    body: { kind, settings, ...(priority === undefined ? {} : { priority }) },
    ...(key === undefined ? {} : { headers: { "Idempotency-Key": key } }),
  });
}

export function estimateJob(kind: string, settings: JsonObject): Promise<Estimate> {
  return ask("jobs", { method: "POST", body: { kind, settings, dry_run: true } });
}

export function cancelJob(id: string): Promise<Job> {
  return ask(`jobs/${id}/cancel`, { method: "POST" });
}

export function retryJob(id: string): Promise<Job> {
  return ask(`jobs/${id}/retry`, { method: "POST" });
}

export async function deleteJob(id: string): Promise<void> {
  await send(`jobs/${id}`, { method: "DELETE" });
}

export type LogLine = { type: string; time_ns: number } & Record<string, unknown>;

export function jobLog(id: string): Promise<LogLine[]> {
  return ask(`jobs/${id}/log`);
}

export interface Capture {
  id: string;
  path: string;
  valid: boolean;
  error: string | null;
  name: string;
  probes: number;
  width: number;
  height: number;
  mapping: string;
  rotating: boolean;
  sorted: boolean;
  simulated: boolean;
  bounds_m: [[number, number, number], [number, number, number]] | null;
}

export async function listCaptures(): Promise<Capture[]> {
  return (await ask<{ captures: Capture[] }>("captures")).captures;
}

export function registerCapture(path: string, id: string | null): Promise<Capture> {
  return ask("captures", { method: "POST", body: id === null ? { path } : { path, id } });
}

export async function forgetCapture(id: string): Promise<void> {
  await send(`captures/${encodeURIComponent(id)}`, { method: "DELETE" });
}

export interface GridSummary {
  id: string;
  job: string;
  path: string;
  bytes: number;
  sha256: string;
  /** Name of the capture that it was made from. */
  capture: string;
  resolution: [number, number, number] | null;
  bands: number | null;
  adaptive: boolean;
  finished_ns: number;
}

export interface GridDocument {
  id: string;
  job: string;
  attributes: JsonObject;
}

export function listGrids(): Promise<GridSummary[]> {
  return ask("grids");
}

export function getGrid(id: string): Promise<GridDocument> {
  return ask(`grids/${id}`);
}

export interface PointSample {
  at: [number, number, number];
  /** bands² rows of [r, g, b]. */
  coefficients: [number, number, number][];
  coverage: number;
}

/** On a new installation the server's first sample compiles a kernel. */
const SAMPLE_TIMEOUT_MS = 60_000;

export async function sampleGrid(id: string, at: readonly number[]): Promise<PointSample> {
  const { points } = await ask<{ points: PointSample[] }>(`grids/${id}/sample?at=${at.join(",")}`, { timeoutMs: SAMPLE_TIMEOUT_MS });
  return points[0]!;
}

export interface Upload {
  id: string;
  kind: "mesh" | "map";
  name: string;
  bytes: number;
  sha256: string;
  created: number;
  vertices: number | null;
  triangles: number | null;
  objects: string[] | null;
  width: number | null;
  height: number | null;
  /** What `POST /streams` takes as the source of a map. */
  source: string | null;
}

/** The uploads, newest first, and how large one may be. */
export function listUploads(): Promise<{ uploads: Upload[]; max_bytes: number }> {
  return ask("uploads");
}

export async function deleteUpload(id: string): Promise<void> {
  await send(`uploads/${encodeURIComponent(id)}`, { method: "DELETE" });
}
