// A part of the queue as a list: its newest page is read again and again, older ones by cursor when they are asked for.

import { batch, signal } from "@preact/signals";

import { listJobs, type Job, type JobFilter } from "../rest.ts";

export const PAGE = 20;

/** Whether `a` stands after `b`: the order of the server, newest first. */
function isAfter(a: Job, b: Job): boolean {
  return a.created !== b.created ? a.created < b.created : a.id < b.id;
}

export class Listing {
  /** Newest first; `null` before they have been read. */
  readonly jobs = signal<Job[] | null>(null);
  /** Where older ones begin; `null`: there are none. */
  readonly next = signal<string | null>(null);

  constructor(private readonly filter: JobFilter = {}) {}

  /** Read the newest page; what was read of older ones stays. */
  async refresh(): Promise<void> {
    const page = await listJobs({ ...this.filter, limit: PAGE });
    const before = this.jobs.peek() ?? [];
    const last = page.jobs.at(-1);
    const older = last === undefined || page.next === null ? [] : before.filter((job) => isAfter(job, last));
    // Where so many have come that nothing is known any more, there would be a gap.
    const touches = before.some(({ id }) => page.jobs.some((job) => job.id === id));
    batch(() => {
      this.jobs.value = touches ? [...page.jobs, ...older] : page.jobs;
      if (older.length === 0 || !touches) this.next.value = page.next;
    });
  }

  /** Read the page that follows. */
  async more(): Promise<void> {
    const cursor = this.next.peek();
    if (cursor === null) return;
    const page = await listJobs({ ...this.filter, limit: PAGE, cursor });
    const known = new Set((this.jobs.peek() ?? []).map(({ id }) => id));
    batch(() => {
      this.jobs.value = [...(this.jobs.peek() ?? []), ...page.jobs.filter(({ id }) => !known.has(id))];
      this.next.value = page.next;
    });
  }

  /** Put a job, as it is now, to its place; it goes where it no longer belongs here. */
  put(job: Job): void {
    const others = (this.jobs.peek() ?? []).filter(({ id }) => id !== job.id);
    const index = others.findIndex((other) => isAfter(other, job));
    const place = index < 0 ? others.length : index;
    this.jobs.value = this.takes(job) ? [...others.slice(0, place), job, ...others.slice(place)] : others;
  }

  remove(id: string): void {
    this.jobs.value = (this.jobs.peek() ?? []).filter((job) => job.id !== id);
  }

  private takes({ state, kind }: Job): boolean {
    return (this.filter.state ?? state) === state && (this.filter.kind ?? kind) === kind;
  }
}
