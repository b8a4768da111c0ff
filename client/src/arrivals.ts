// Files on their way, as the page shows them. They outlive a reload: the tab remembers all but their bytes.

import { signal } from "@preact/signals";

export type Phase = "waiting" | "uploading" | "computing" | "ready" | "failed" | "cancelled";

/** One file on its way. */
export interface Arrival {
  /** Names it for as long as the tab is open, and its job for the server. */
  key: string;
  name: string;
  bytes: number;
  kind: "mesh" | "map";
  phase: Phase;
  /** How much of it has been sent, 0 … 1. */
  sent: number;
  /** What the server calls it, once it has it. */
  upload: string | null;
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

const PLACE = "lightwell.files";

export const arrivals = signal<readonly Arrival[]>([]);

export function newArrival(name: string, kind: Arrival["kind"], part: Partial<Arrival> = {}): Arrival {
  const fresh = { bytes: 0, phase: "waiting", sent: 0, upload: null, job: null, stream: null, shown: false, problem: "", again: false };
  return { key: newKey(), name, kind, ...(fresh as Omit<Arrival, "key" | "name" | "kind">), ...part };
}

/** A key that no other page has. Without TLS there is no `randomUUID`. */
export function newKey(): string {
  return Array.from(crypto.getRandomValues(new Uint32Array(3)), (word) => word.toString(36)).join("-");
}

export function find(key: string): Arrival | undefined {
  return arrivals.peek().find((arrival) => arrival.key === key);
}

export function add(more: readonly Arrival[]): void {
  arrivals.value = [...arrivals.peek(), ...more];
}

export function update(key: string, part: Partial<Arrival>): void {
  arrivals.value = arrivals.peek().map((arrival) => (arrival.key === key ? { ...arrival, ...part } : arrival));
}

export function forget(key: string): void {
  arrivals.value = arrivals.peek().filter((arrival) => arrival.key !== key);
}

/** Take up what the tab remembers, and keep it. Returns what was unfinished when the page was left. */
export function recall(storage: Storage): readonly Arrival[] {
  let found: Arrival[] = [];
  try {
    found = JSON.parse(storage.getItem(PLACE) ?? "[]") as Arrival[];
  } catch {
    // Something else lies there, or nothing may be read: there is nothing to recall.
  }
  // What is in the picture needs no words any more.
  arrivals.value = found.filter(({ phase, shown }) => !(phase === "ready" && shown));
  arrivals.subscribe((list) => {
    try {
      storage.setItem(PLACE, JSON.stringify(list));
    } catch {
      // A browser that keeps nothing loses the lines on a reload, and nothing else.
    }
  });
  return arrivals.peek().filter(({ phase }) => phase === "waiting" || phase === "uploading" || phase === "computing");
}
