// The queue as the page knows it: a list that is read again now and then, and server-sent events of what runs.

import { batch, computed, signal } from "@preact/signals";

import { here, words } from "../api.ts";
import {
  FINISHED,
  cancelJob,
  deleteJob,
  getJob,
  jobKinds,
  retryJob,
  submitJob,
  type Job,
  type JobKind,
  type JobState,
  type JsonObject,
  type Progress,
  type Submission,
} from "../rest.ts";
import { view } from "../view.ts";
import { Listing } from "./listing.ts";

const BUSY_POLL_MS = 3000;
const IDLE_POLL_MS = 12_000;
const FLUSH_MS = 250;
/** Browsers open six connections to a server; event streams may not take them all. */
const MOST_STREAMS = 3;

const newest = new Listing();

export const kinds = signal<JobKind[] | null>(null);
/** The newest jobs, of every state and kind. */
export const jobs = newest.jobs;
/** The jobs that the panel lists: all, or those of a state and kind. */
export const listed = signal(newest);
/** Why the lists cannot be had, in words. */
export const jobsProblem = signal("");
/** Rises whenever a job ends: what lists results reads them again. */
export const ended = signal(0);
export const unfinished = computed(() => (jobs.value ?? []).filter((job) => !isFinished(job)));

let timer: ReturnType<typeof setTimeout> | undefined;

export function isFinished({ state }: { state: JobState }): boolean {
  return FINISHED.includes(state);
}

/** Read the lists for as long as the page is open. */
export function startJobs(): void {
  const poll = async () => {
    if (!document.hidden) await refreshJobs();
    const soon = unfinished.peek().length > 0 || view.peek().tab === "jobs";
    clearTimeout(timer);
    timer = setTimeout(() => void poll(), soon ? BUSY_POLL_MS : IDLE_POLL_MS);
  };
  let shown: string | null = null;
  view.subscribe(({ tab, jobState, jobKind }) => {
    const wanted = tab === "jobs" ? `${jobState} ${jobKind}` : null;
    if (wanted === shown) return;
    shown = wanted;
    if (wanted === null) return;
    const filter = { ...(jobState === null ? {} : { state: jobState }), ...(jobKind === null ? {} : { kind: jobKind }) };
    listed.value = Object.keys(filter).length === 0 ? newest : new Listing(filter);
    void poll();
  });
  if (shown === null) void poll();
}

export async function refreshJobs(): Promise<void> {
  await attempt(async () => {
    for (const listing of listings()) await settle(() => listing.refresh());
  });
}

/** Read older jobs. */
export async function showMore(): Promise<void> {
  await attempt(() => settle(() => listed.peek().more()));
}

async function attempt(work: () => Promise<void>): Promise<void> {
  try {
    await work();
    jobsProblem.value = "";
  } catch (error) {
    jobsProblem.value = words(error);
  }
}

/** The kinds of jobs; asked for once. */
export async function loadKinds(): Promise<void> {
  kinds.value ??= await jobKinds();
}

function listings(): Listing[] {
  return listed.peek() === newest ? [newest] : [newest, listed.peek()];
}

function everyJob(): Job[] {
  return listings().flatMap((listing) => listing.jobs.peek() ?? []);
}

/** Change the lists, and do what follows from it: note what has ended, and listen to what runs. */
async function settle(work: () => Promise<void> | void): Promise<void> {
  const running = new Set(everyJob().filter((job) => !isFinished(job)).map(({ id }) => id));
  await work();
  batch(() => {
    applyEvents();
    if (everyJob().some((job) => isFinished(job) && running.has(job.id))) ended.value++;
  });
  for (const job of everyJob()) if (!isFinished(job) && job.state !== "queued") follow(job.id);
}

function applyEvents(): void {
  for (const { jobs: list } of listings()) if (list.peek() !== null) list.value = list.peek()!.map(withEvents);
}

/** Put one job into the lists. */
function put(job: Job): void {
  void settle(() => {
    for (const listing of listings()) listing.put(job);
  });
}

/** A job with what its events have said: they are newer than a list, except for a cancellation. */
function withEvents(job: Job): Job {
  const latest = followers.get(job.id)?.latest;
  if (latest === undefined || isFinished(job)) return job;
  const state = job.state === "queued" ? (latest.state ?? job.state) : job.state;
  return { ...job, state, progress: latest.progress ?? job.progress };
}

interface Follower {
  source: EventSource;
  /** What the events have said since the list was read. */
  latest: { state?: JobState; progress?: Progress };
  flushTimer: ReturnType<typeof setTimeout> | undefined;
}

const followers = new Map<string, Follower>();

/** Listen to a job's events; the browser resumes after an interruption with the id of the last one. */
function follow(id: string): void {
  if (followers.has(id) || followers.size >= MOST_STREAMS) return;
  const source = new EventSource(here(`jobs/${id}/events`));
  const follower: Follower = { source, latest: {}, flushTimer: undefined };
  followers.set(id, follower);
  const stop = () => {
    clearTimeout(follower.flushTimer);
    source.close();
    followers.delete(id);
  };
  const note = (part: Follower["latest"]) => {
    follower.latest = { ...follower.latest, ...part };
    follower.flushTimer ??= setTimeout(() => {
      follower.flushTimer = undefined;
      batch(applyEvents);
    }, FLUSH_MS);
  };
  const read = <T>(event: Event) => JSON.parse((event as MessageEvent<string>).data) as T;
  source.addEventListener("progress", (event) => {
    const { stage, done, total, rate, eta_seconds } = read<Progress>(event);
    note({ progress: { stage, done, total, rate, eta_seconds } });
  });
  source.addEventListener("state", (event) => {
    // How it ended comes with `end`; before, a job that was retried tells its earlier ends again.
    if (read<{ state: JobState }>(event).state === "running") note({ state: "running" });
  });
  source.addEventListener("end", (event) => {
    stop();
    const job = read<Job>(event);
    if (everyJob().some((item) => item.id === id)) put(job);
    for (const resolve of waiting.get(id) ?? []) resolve(job);
    waiting.delete(id);
  });
  source.onerror = () => {
    if (source.readyState === EventSource.CLOSED) stop();
  };
}

const waiting = new Map<string, ((job: Job) => void)[]>();

/** Wait until a job has ended. */
export async function whenFinished(id: string): Promise<Job> {
  for (;;) {
    follow(id);
    const told = new Promise<Job>((resolve) => waiting.set(id, [...(waiting.get(id) ?? []), resolve]));
    // Where no event stream is to be had, ask.
    const asked = new Promise<null>((resolve) => setTimeout(() => resolve(null), BUSY_POLL_MS));
    const job = (await Promise.race([told, asked])) ?? (await getJob(id));
    if (isFinished(job)) return job;
    put(job);
  }
}

export async function submit(kind: string, settings: JsonObject, options: Submission = {}): Promise<Job> {
  const job = await submitJob(kind, settings, options);
  put(job);
  return job;
}

export async function cancel(id: string): Promise<void> {
  put(await cancelJob(id));
}

export async function retry(id: string): Promise<void> {
  put(await retryJob(id));
}

export async function remove(id: string): Promise<void> {
  await deleteJob(id);
  batch(() => {
    for (const listing of listings()) listing.remove(id);
    ended.value++;
  });
}
