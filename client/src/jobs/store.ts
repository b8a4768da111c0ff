// The queue as the page knows it: a list that is read again now and then, and server-sent events of what runs.

import { batch, computed, signal } from "@preact/signals";

import { here, words } from "../api.ts";
import {
  FINISHED,
  cancelJob,
  deleteJob,
  getJob,
  jobKinds,
  listJobs,
  retryJob,
  submitJob,
  type Job,
  type JobKind,
  type JobState,
  type JsonObject,
  type Progress,
} from "../rest.ts";
import { view } from "../view.ts";

const BUSY_POLL_MS = 3000;
const IDLE_POLL_MS = 12_000;
const FLUSH_MS = 250;
const FIRST_COUNT = 20;
const MOST = 200;
/** Browsers open six connections to a server; event streams may not take them all. */
const MOST_STREAMS = 3;

export const kinds = signal<JobKind[] | null>(null);
export const jobs = signal<Job[] | null>(null);
/** Why the list cannot be had, in words. */
export const jobsProblem = signal("");
export const hasMore = signal(false);
/** Rises whenever a job ends: what lists results reads them again. */
export const ended = signal(0);
export const unfinished = computed(() => (jobs.value ?? []).filter((job) => !isFinished(job)));

let wanted = FIRST_COUNT;
let timer: ReturnType<typeof setTimeout> | undefined;

export function isFinished({ state }: { state: JobState }): boolean {
  return FINISHED.includes(state);
}

/** Read the list for as long as the page is open. */
export function startJobs(): void {
  const poll = async () => {
    if (!document.hidden) await refreshJobs();
    const soon = unfinished.peek().length > 0 || view.peek().tab === "jobs";
    timer = setTimeout(() => void poll(), soon ? BUSY_POLL_MS : IDLE_POLL_MS);
  };
  void poll();
  let tab = view.peek().tab;
  view.subscribe((next) => {
    if (next.tab === "jobs" && tab !== "jobs") {
      clearTimeout(timer);
      void poll();
    }
    tab = next.tab;
  });
}

export async function refreshJobs(): Promise<void> {
  try {
    const page = await listJobs({ limit: wanted });
    batch(() => {
      take(page.jobs);
      hasMore.value = page.next !== null && wanted < MOST;
      jobsProblem.value = "";
    });
  } catch (error) {
    jobsProblem.value = words(error);
  }
}

export function showMore(): void {
  wanted = Math.min(MOST, 2 * wanted);
  void refreshJobs();
}

/** The kinds of jobs; asked for once. */
export async function loadKinds(): Promise<void> {
  kinds.value ??= await jobKinds();
}

function take(list: Job[]): void {
  const before = new Map((jobs.peek() ?? []).map((job) => [job.id, job]));
  if (list.some((job) => isFinished(job) && before.has(job.id) && !isFinished(before.get(job.id)!))) ended.value++;
  jobs.value = list.map(withEvents);
  for (const job of list) {
    if (!isFinished(job)) followers.get(job.id) ?? (job.state !== "queued" && follow(job.id));
  }
}

/** Put one job into the list, at its place or at the top. */
function put(job: Job): void {
  const list = jobs.peek() ?? [];
  const known = list.some(({ id }) => id === job.id);
  take(known ? list.map((item) => (item.id === job.id ? job : item)) : [job, ...list]);
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
  if (followers.size >= MOST_STREAMS) return;
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
      jobs.value = (jobs.peek() ?? []).map(withEvents);
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
    if ((jobs.peek() ?? []).some((item) => item.id === id)) put(job);
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
    if (!followers.has(id)) follow(id);
    const told = new Promise<Job>((resolve) => waiting.set(id, [...(waiting.get(id) ?? []), resolve]));
    // Where no event stream is to be had, ask.
    const asked = new Promise<null>((resolve) => setTimeout(() => resolve(null), BUSY_POLL_MS));
    const job = (await Promise.race([told, asked])) ?? (await getJob(id));
    if (isFinished(job)) return job;
    put(job);
  }
}

export async function submit(kind: string, settings: JsonObject): Promise<Job> {
  const job = await submitJob(kind, settings);
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
  jobs.value = (jobs.peek() ?? []).filter((job) => job.id !== id);
  ended.value++;
}
