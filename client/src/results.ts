// What finished jobs have left that can be shown: grids, and objects with their transfer.

import { effect, signal } from "@preact/signals";

import { words } from "./api.ts";
import { ended, kinds, loadKinds } from "./jobs/store.ts";
import { baseName } from "./jobs/words.ts";
import { listGrids, listJobs, listUploads, type GridSummary, type Job, type Upload } from "./rest.ts";
import { change, isOfGrid, view } from "./view.ts";

const POLL_MS = 30_000;
const TRANSFER = "prt-transfer";

export const grids = signal<GridSummary[] | null>(null);
export const gridsProblem = signal("");
/** Finished transfer jobs, newest first. */
export const transfers = signal<Job[]>([]);
/** What was sent to the server, newest first; `null` before it has been asked. */
export const uploads = signal<Upload[] | null>(null);
export const uploadsProblem = signal("");
/** Largest file that the server takes, bytes; `null`: not known. */
export const largestUpload = signal<number | null>(null);

/** Read what there is now, whenever a job has ended, and now and then. */
export function startResults(): void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const poll = () => {
    clearTimeout(timer);
    void refreshResults();
    timer = setTimeout(poll, POLL_MS);
  };
  effect(() => {
    ended.value;
    poll();
  });
  effect(() => {
    // A grid was asked for before there was one.
    const first = grids.value?.[0];
    if (isOfGrid(view.value.light) && view.value.grid === null && first !== undefined) change({ grid: first.id });
  });
}

export async function refreshResults(): Promise<void> {
  await Promise.all([
    listGrids().then(
      (list) => {
        grids.value = list;
        gridsProblem.value = "";
      },
      (error: unknown) => (gridsProblem.value = words(error)),
    ),
    refreshObjects().then(
      () => (uploadsProblem.value = ""),
      (error: unknown) => (uploadsProblem.value = words(error)),
    ),
  ]);
}

async function refreshObjects(): Promise<void> {
  await loadKinds();
  if (!kinds.peek()?.some(({ name }) => name === TRANSFER)) return;
  const [page, list] = await Promise.all([listJobs({ kind: TRANSFER, state: "succeeded" }), listUploads()]);
  transfers.value = page.jobs;
  uploads.value = list.uploads;
  largestUpload.value = list.max_bytes;
}

/** What people call the input of a job: the capture's folder, the uploaded file, the scene. */
export function subjectOf(job: Job): string {
  const { capture, mesh, scene } = job.settings;
  const given = [capture, mesh, scene].find((value) => typeof value === "string") ?? "";
  return uploads.value?.find(({ id }) => id === given)?.name ?? baseName(given);
}
