import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";

import type { Job } from "../rest.ts";

const JOB: Job = {
  id: "0123456789",
  kind: "ilf-grid",
  state: "queued",
  priority: 100,
  settings: {},
  progress: null,
  attempts: 1,
  created: 1,
  started: null,
  finished: null,
  artifacts: [],
  error: null,
  preview_ns: null,
};

class Source {
  static readonly CLOSED = 2;
  static made: Source[] = [];
  readyState = 1;
  onerror = () => undefined;
  private readonly listeners = new Map<string, (event: { data: string }) => void>();

  constructor(readonly url: string) {
    Source.made.push(this);
  }

  addEventListener(name: string, listener: (event: { data: string }) => void): void {
    this.listeners.set(name, listener);
  }

  tell(name: string, data: unknown): void {
    this.listeners.get(name)!({ data: JSON.stringify(data) });
  }

  close(): void {
    this.readyState = Source.CLOSED;
  }
}

let answers: Record<string, unknown> = {};

beforeEach(() => {
  vi.useFakeTimers();
  Source.made = [];
  vi.stubGlobal("document", { baseURI: "http://127.0.0.1:8400/?token=a%2Bb", hidden: false });
  vi.stubGlobal("EventSource", Source);
  vi.stubGlobal("fetch", (url: URL) => {
    const path = url.pathname.replace("/api/v1/", "");
    return Promise.resolve(new Response(JSON.stringify(answers[path]), { status: 200 }));
  });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
  vi.resetModules();
});

describe("the queue on the page", () => {
  it("follows what runs by events, few times a second, and says when it has ended", async () => {
    const { jobs, refreshJobs, whenFinished, ended } = await import("./store.ts");
    answers = { jobs: { jobs: [{ ...JOB, state: "running" }], next: null } };
    await refreshJobs();
    expect(Source.made.map(({ url }) => url)).toEqual(["http://127.0.0.1:8400/api/v1/jobs/0123456789/events?token=a%2Bb"]);
    const [source] = Source.made;
    const finished = whenFinished(JOB.id);

    let changes = 0;
    jobs.subscribe(() => changes++);
    for (let done = 0; done < 50; done++) source!.tell("progress", { stage: "sort", done, total: 50, rate: 5, eta_seconds: 1 });
    expect(changes).toBe(1);
    vi.advanceTimersByTime(300);
    expect(changes).toBe(2);
    expect(jobs.value![0]!.progress).toEqual({ stage: "sort", done: 49, total: 50, rate: 5, eta_seconds: 1 });

    source!.tell("end", { ...JOB, state: "succeeded" });
    expect((await finished).state).toBe("succeeded");
    expect(jobs.value![0]!.state).toBe("succeeded");
    expect(ended.value).toBe(1);
    expect(source!.readyState).toBe(Source.CLOSED);
  });

  it("does not take an earlier event for news against a cancellation", async () => {
    const { jobs, cancel, refreshJobs } = await import("./store.ts");
    answers = { jobs: { jobs: [{ ...JOB, state: "running" }], next: null }, [`jobs/${JOB.id}/cancel`]: { ...JOB, state: "cancelling" } };
    await refreshJobs();
    Source.made[0]!.tell("state", { state: "running" });
    vi.advanceTimersByTime(300);
    await cancel(JOB.id);
    expect(jobs.value![0]!.state).toBe("cancelling");
  });
});
