// Files that are brought to the page: a mesh is uploaded, its transfer computed, and the object shown; a map becomes a
// stream that is followed.

import { ApiError, apiUrl, problemError, words } from "./api.ts";
import { add, find, forget, newArrival, newKey, recall, update, type Arrival } from "./arrivals.ts";
import { kindOfFile, refusal, streamName } from "./files.ts";
import { cancel, submit, whenFinished } from "./jobs/store.ts";
import { largestUpload, refreshResults } from "./results.ts";
import { createStream, getJob, listStreams, listUploads, type Job, type JsonObject, type Upload } from "./rest.ts";
import { chooseStream } from "./session.ts";
import { change } from "./view.ts";

/** Something has to stand on something for its shadow to be seen. */
export const ON_A_TABLE = { ground: true, ground_radius: 1.6 };
/** What is in the picture needs no words for long. */
const SHOWN_MS = 10_000;
/** A file that had been sent when the page was left may still be looked at by the server. */
const INSPECTION_POLLS = 10;
const POLL_MS = 1000;

const aborts = new Map<string, AbortController>();
const files = new Map<string, File>();

/** Take files, one upload after the other. The first mesh and the first map of them are shown when they are ready. */
export function takeFiles(chosen: readonly File[]): void {
  const seen = new Set<string>();
  const taken: Arrival[] = [];
  for (const file of chosen) {
    const kind = kindOfFile(file.name);
    const problem = refusal(file.name, file.size, largestUpload.peek());
    const phase = problem === "" ? "waiting" : "failed";
    const arrival = newArrival(file.name, kind, { bytes: file.size, phase, problem, shown: problem === "" && !seen.has(kind) });
    if (problem === "") {
      seen.add(kind);
      files.set(arrival.key, file);
    }
    taken.push(arrival);
  }
  add(taken);
  for (const arrival of taken) if (arrival.phase === "waiting") start(arrival.key);
}

/** Refuse what is no file at all. */
export function refuseFolder(name: string): void {
  add([newArrival(name, "mesh", { phase: "failed", problem: "Folders are not taken: drop the files that lie in it." })]);
}

/** Go on with what was on its way when the page was left. */
export function resumeArrivals(): void {
  for (const arrival of recall(sessionStorage)) {
    const { key } = arrival;
    run(key, async () => {
      if (arrival.job !== null) return await followJob(key, await getJob(arrival.job));
      await finish(key, await findSent(arrival));
    });
  }
}

let queue: Promise<void> = Promise.resolve();

function start(key: string): void {
  update(key, { phase: "waiting", sent: 0, problem: "", job: null });
  run(key, async (signal) => {
    const uploaded = queue.then(() => bring(key, signal));
    // The next upload begins when this one has been sent; jobs wait in the server's queue.
    queue = uploaded.then(
      () => undefined,
      () => undefined,
    );
    await finish(key, await uploaded);
  });
}

/** Do something for a file, and say on its line how it failed where it does. */
function run(key: string, work: (signal: AbortSignal) => Promise<void>): void {
  const abort = new AbortController();
  aborts.set(key, abort);
  work(abort.signal).catch((error: unknown) => {
    if (abort.signal.aborted) update(key, { phase: "cancelled", again: canStart(key) });
    else {
      const problem = withoutName(words(error), find(key)?.name ?? "");
      update(key, { phase: "failed", problem, again: mayPass(error) && canStart(key) });
    }
  });
}

async function bring(key: string, signal: AbortSignal): Promise<Upload> {
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

/** What the server has of a file that was being sent when the page was left. */
async function findSent({ key, upload, sent, name, bytes }: Arrival): Promise<Upload> {
  for (let poll = 0; poll < (sent < 1 ? 1 : INSPECTION_POLLS); poll++) {
    if (poll > 0) await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    if (find(key) === undefined) break; // dismissed meanwhile
    const { uploads } = await listUploads();
    const found = uploads.find((one) => (upload === null ? one.name === name && one.bytes === bytes : one.id === upload));
    if (found !== undefined) return found;
  }
  throw new Error("The page was left before the file had been sent: drop it again.");
}

/** Make of an upload what it is for. */
async function finish(key: string, upload: Upload): Promise<void> {
  update(key, { upload: upload.id });
  if (find(key)?.kind === "map") await makeStream(key, upload);
  else await makeObject(key, upload);
}

async function makeObject(key: string, upload: Upload): Promise<void> {
  if (upload.kind !== "mesh") throw new Error("The server took this for a map, not for a mesh.");
  void refreshResults(); // so that the job is called by the file's name
  // Whoever comes back after a reload finds the job that was submitted in the last moment.
  await followJob(key, await submit("prt-transfer", { mesh: upload.id, ...ON_A_TABLE }, { key }));
}

async function followJob(key: string, { id }: Job): Promise<void> {
  update(key, { phase: "computing", job: id });
  const job = await whenFinished(id);
  if (job.state === "cancelled") {
    update(key, { phase: "cancelled", again: canStart(key) });
  } else if (job.state === "failed") {
    update(key, { phase: "failed", problem: job.error ?? "The job failed; its log says more.", again: canStart(key) });
  } else {
    update(key, { phase: "ready" });
    if (find(key)?.shown) show(key);
  }
}

async function makeStream(key: string, upload: Upload): Promise<void> {
  update(key, { phase: "ready", stream: await streamOf(upload) });
  if (find(key)?.shown) show(key);
}

/** The name of a stream that shows a map; it is made where there is none. */
export async function streamOf({ name, source }: Upload): Promise<string> {
  if (source === null) throw new Error("The server took this for a mesh, not for a map.");
  const known = (await listStreams()).find(({ settings }) => settings.source === source);
  return known?.name ?? (await createNamed(streamName(name), { source }));
}

/** Make a stream; where its name is taken, with a number after it. */
async function createNamed(name: string, settings: JsonObject): Promise<string> {
  for (let number = 1; ; number++) {
    const tried = number === 1 ? name : `${name}-${number}`;
    try {
      await createStream(tried, settings);
      return tried;
    } catch (error) {
      if (!(error instanceof ApiError && error.status === 409 && number < 100)) throw error;
    }
  }
}

/** Put what has arrived into the picture. */
export function show(key: string): void {
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

/** Whether there is what a new beginning needs: the file, or the server's copy. */
function canStart(key: string): boolean {
  return files.has(key) || find(key)?.upload != null;
}

/** Stop an upload, or the job that follows it. */
export async function stop(key: string): Promise<void> {
  const job = find(key)?.job;
  aborts.get(key)?.abort();
  if (job != null) await cancel(job).catch((error: unknown) => update(key, { problem: words(error) }));
}

/** Try it again, under a new key: the old one stands for a job that has ended. */
export function again(key: string): void {
  const old = find(key);
  if (old === undefined) return;
  const fresh = { ...old, key: newKey() };
  const file = files.get(key);
  dismiss(key);
  add([fresh]);
  if (file !== undefined) {
    files.set(fresh.key, file);
    start(fresh.key);
  } else {
    update(fresh.key, { phase: "uploading", sent: 1, problem: "", job: null });
    run(fresh.key, async () => finish(fresh.key, await findSent(fresh)));
  }
}

export function dismiss(key: string): void {
  forget(key);
  aborts.delete(key);
  files.delete(key);
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
