import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";

import type { Job } from "../rest.ts";
import { Listing, PAGE } from "./listing.ts";

/** Job number `n`; a higher one is newer. */
function job(n: number, state: Job["state"] = "succeeded"): Job {
  const fixed = { kind: "ilf-grid", priority: 100, settings: {}, progress: null, attempts: 1, started: null, finished: null, artifacts: [], error: null, preview_ns: null };
  return { id: String(n).padStart(4, "0"), state, created: n, ...fixed };
}

let all: Job[] = [];
let asked: URLSearchParams[] = [];

beforeEach(() => {
  all = Array.from({ length: 50 }, (_, n) => job(n));
  asked = [];
  vi.stubGlobal("document", { baseURI: "http://127.0.0.1:8400/" });
  // A server whose cursor is the last id of a page, as the real one's is in effect.
  vi.stubGlobal("fetch", ({ searchParams }: URL) => {
    asked.push(searchParams);
    const cursor = searchParams.get("cursor");
    const state = searchParams.get("state");
    const found = all
      .filter((one) => (cursor === null || one.id < cursor) && (state === null || one.state === state))
      .sort((a, b) => b.created - a.created);
    const jobs = found.slice(0, Number(searchParams.get("limit")));
    return Promise.resolve(new Response(JSON.stringify({ jobs, next: found.length > jobs.length ? jobs.at(-1)!.id : null })));
  });
});

afterEach(() => void vi.unstubAllGlobals());

const ids = (listing: Listing) => listing.jobs.value!.map(({ created }) => created);
const down = (from: number, to: number) => Array.from({ length: from - to + 1 }, (_, k) => from - k);

describe("a list of jobs", () => {
  it("reads older pages by cursor, and keeps them while new jobs come", async () => {
    const listing = new Listing();
    await listing.refresh();
    expect(ids(listing)).toEqual(down(49, 50 - PAGE));
    await listing.more();
    all.push(job(50), job(51));
    await listing.refresh();
    expect(ids(listing)).toEqual(down(51, 50 - 2 * PAGE));
    await listing.more();
    expect(ids(listing)).toEqual(down(51, 0));
    expect(listing.next.value).toBeNull();
    await listing.more();
    expect(asked.length).toBe(4);
  });

  it("forgets what was deleted, and begins anew where there would be a gap", async () => {
    const listing = new Listing();
    await listing.refresh();
    await listing.more();
    all = all.filter(({ created }) => created !== 45);
    await listing.refresh();
    expect(ids(listing)).toEqual(down(49, 50 - 2 * PAGE).filter((n) => n !== 45));
    all.push(...Array.from({ length: 40 }, (_, k) => job(50 + k)));
    await listing.refresh();
    expect(ids(listing)).toEqual(down(89, 90 - PAGE));
    expect(listing.next.value).toBe(String(90 - PAGE).padStart(4, "0"));
  });

  it("holds only what its filter takes, each at its place", async () => {
    all[7] = job(7, "failed");
    const listing = new Listing({ state: "failed" });
    await listing.refresh();
    expect(ids(listing)).toEqual([7]);
    listing.put(job(9, "failed"));
    listing.put(job(3, "failed"));
    listing.put(job(30, "running"));
    expect(ids(listing)).toEqual([9, 7, 3]);
    listing.put(job(7, "running"));
    listing.remove("0003");
    expect(ids(listing)).toEqual([9]);
  });
});
