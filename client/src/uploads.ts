// Files that are brought to the page: a mesh is uploaded, its transfer computed, and the object shown; a map becomes a
// stream that is followed.

import { signal } from "@preact/signals";

import { ApiError, apiUrl, problemError, words } from "./api.ts";
import { kindOfFile, refusal, streamName } from "./files.ts";
import { cancel, submit, whenFinished } from "./jobs/store.ts";
import { largestUpload, refreshResults } from "./results.ts";
import { createStream, type Upload } from "./rest.ts";
import { chooseStream } from "./session.ts";
import { change } from "./view.ts";

export type Phase = "waiting" | "uploading" | "computing" | "ready" | "failed" | "cancelled";

/** One file on its way. */
export interface Arrival {
  key: number;
  name: string;
  kind: "mesh" | "map";
  phase: Phase;
  /** How much of it has been sent, 0 … 1. */
  sent: number;
  /** The transfer job, once there is one. */
  job: string | null;
  /** The name of the stream that a map has become. */
  stream: string | null;
  /** Whether it is, or was, put into the picture when it was ready. */
  shown: boolean;
  problem: string;
  /** Whether trying again may help: not where the file itself is refused. */
  again: boolean;
}

/** Something has to stand on something for its shadow to be seen. */
const ON_A_TABLE = { ground: true, ground_radius: 2 };
/** What is in the picture needs no words for long. */
const SHOWN_MS = 10_000;

export const arrivals = signal<readonly Arrival[]>([]);

const aborts = new Map<number, AbortController>();
const files = new Map<number, File>();
let lastKey = 0;

/** Take files, one upload after the other. The first mesh and the first map of them are shown when they are ready. */
export function takeFiles(chosen: readonly File[]): void {
  const seen = new Set<string>();
  const taken: Arrival[] = [];
  for (const file of chosen) {
    const kind = kindOfFile(file.name);
    const problem = refusal(file.name, file.size, largestUpload.peek());
    const arrival: Arrival = {
      key: ++lastKey,
      name: file.name,
      kind,
      phase: problem === "" ? "waiting" : "failed",
      sent: 0,
      job: null,
      stream: null,
      shown: problem === "" && !seen.has(kind),
      problem,
      again: false,
    };
    if (problem === "") {
      seen.add(kind);
      files.set(arrival.key, file);
    }
    taken.push(arrival);
  }
  arrivals.value = [...arrivals.value, ...taken];
  for (const arrival of taken) if (arrival.phase === "waiting") start(arrival.key);
}

/** Refuse what is no file at all. */
export function refuseFolder(name: string): void {
  const problem = "Folders are not taken: drop the files that lie in it.";
  const refused = { kind: "mesh", phase: "failed", sent: 0, job: null, stream: null, shown: false, again: false } as const;
  arrivals.value = [...arrivals.value, { key: ++lastKey, name, ...refused, problem }];
}

let queue: Promise<void> = Promise.resolve();

function start(key: number): void {
  const abort = new AbortController();
  aborts.set(key, abort);
  update(key, { phase: "waiting", sent: 0, problem: "", job: null });
  const uploaded = queue.then(() => bring(key, abort.signal));
  // The next upload begins when this one has been sent; jobs wait in the server's queue.
  queue = uploaded.then(
    () => undefined,
    () => undefined,
  );
  void uploaded
    .then((upload) => (find(key)?.kind === "map" ? makeStream(key, upload) : makeObject(key, upload)))
    .catch((error: unknown) => {
      if (abort.signal.aborted) update(key, { phase: "cancelled", again: true });
      else update(key, { phase: "failed", problem: withoutName(words(error), find(key)?.name ?? ""), again: mayPass(error) });
    });
}

async function bring(key: number, signal: AbortSignal): Promise<Upload> {
  signal.throwIfAborted();
  update(key, { phase: "uploading" });
  let toldMs = 0;
  return await sendFile(files.get(key)!, signal, (sent) => {
    const timeMs = performance.now();
    if (timeMs - toldMs < 200 && sent < 1) return;
    toldMs = timeMs;
    update(key, { sent });
  });
}

async function makeObject(key: number, upload: Upload): Promise<void> {
  if (upload.kind !== "mesh") throw new Error("The server took this for a map, not for a mesh.");
  const { id } = await submit("prt-transfer", { mesh: upload.id, ...ON_A_TABLE });
  update(key, { phase: "computing", job: id });
  void refreshResults(); // so that the job is called by the file's name
  const job = await whenFinished(id);
  if (job.state === "cancelled") {
    update(key, { phase: "cancelled", again: true });
  } else if (job.state === "failed") {
    update(key, { phase: "failed", problem: job.error ?? "The job failed; its log says more.", again: true });
  } else {
    update(key, { phase: "ready" });
    if (find(key)?.shown) show(key);
  }
}

async function makeStream(key: number, upload: Upload): Promise<void> {
  if (upload.source === null) throw new Error("The server took this for a mesh, not for a map.");
  const name = await createNamed(streamName(upload.name), { source: upload.source });
  update(key, { phase: "ready", stream: name });
  if (find(key)?.shown) show(key);
}

/** Make a stream; where its name is taken, with a number after it. */
async function createNamed(name: string, settings: { source: string }): Promise<string> {
  for (let number = 1; ; number++) {
    const tried = number === 1 ? name : `${name}-${number}`;
    try {
      await createStream(tried, { source: settings.source });
      return tried;
    } catch (error) {
      if (!(error instanceof ApiError && error.status === 409 && number < 100)) throw error;
    }
  }
}

/** Put what has arrived into the picture. */
export function show(key: number): void {
  const arrival = find(key);
  if (arrival?.job != null) change({ object: arrival.job, shadows: true });
  if (arrival?.stream != null) {
    chooseStream(arrival.stream);
    // A map that nobody sees would be a surprise.
    change({ light: "stream" });
  }
  update(key, { shown: true });
  setTimeout(() => {
    if (find(key)?.phase === "ready") dismiss(key);
  }, SHOWN_MS);
}

/** The server begins its words with the file's name, which stands above them. */
function withoutName(problem: string, name: string): string {
  const start = `${name}: `;
  if (!problem.toLowerCase().startsWith(start.toLowerCase())) return problem;
  const rest = problem.slice(start.length);
  return rest === "" ? problem : `It ${rest}`;
}

/** Whether the same request may succeed later. */
function mayPass(error: unknown): boolean {
  return !(error instanceof ApiError) || error.status === 0 || error.status >= 500;
}

/** Stop an upload, or the job that follows it. */
export async function stop(key: number): Promise<void> {
  const job = find(key)?.job;
  aborts.get(key)?.abort();
  if (job != null) await cancel(job).catch((error: unknown) => update(key, { problem: words(error) }));
}

export function again(key: number): void {
  if (files.has(key)) start(key);
}

export function dismiss(key: number): void {
  arrivals.value = arrivals.value.filter((arrival) => arrival.key !== key);
  aborts.delete(key);
  files.delete(key);
}

function find(key: number): Arrival | undefined {
  return arrivals.peek().find((arrival) => arrival.key === key);
}

function update(key: number, part: Partial<Arrival>): void {
  arrivals.value = arrivals.peek().map((arrival) => (arrival.key === key ? { ...arrival, ...part } : arrival));
}

/** Send a file as it is; fetch cannot tell how far it has come. */
function sendFile(file: File, signal: AbortSignal, progress: (sent: number) => void): Promise<Upload> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const url = apiUrl(document.baseURI, "uploads");
    url.searchParams.set("name", file.name);
    request.open("POST", url);
    request.responseType = "json";
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.onprogress = ({ loaded, total }) => progress(total > 0 ? loaded / total : 0);
    request.onload = () => {
      if (request.status === 200 || request.status === 201) resolve(request.response as Upload);
      else reject(problemError(request.status, request.response));
    };
    request.onerror = () => reject(new ApiError("The connection broke while the file was sent; it may be too large for the server.", 0));
    request.onabort = () => reject(new ApiError("Cancelled.", 0));
    signal.addEventListener("abort", () => request.abort(), { once: true });
    request.send(file);
  });
}
