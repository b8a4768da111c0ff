// The server stamps frames with its clock, the page reads its own. On one machine they are the same clock.

import { History } from "./rate.ts";

let originMs = performance.timeOrigin;

/**
 * Milliseconds since the Unix epoch, with the resolution of the performance timer.
 *
 * The timer may stop while the machine sleeps and is not set when its clock is. So the clock, which tells whole
 * milliseconds, bounds the timer's origin at each call; the timer only fills in the fraction.
 */
export function nowMs(): number {
  const elapsedMs = performance.now();
  const earliestMs = Date.now() - elapsedMs;
  originMs = Math.min(Math.max(originMs, earliestMs), earliestMs + 1);
  return originMs + elapsedMs;
}

const LOCAL_HOSTS = new Set(["localhost", "127.0.0.1", "[::1]"]);

/** Clocks drift and are set: what a message showed of them counts for so long, or until there is a newer one. */
const TRUSTED_MS = 60_000;

/**
 * Estimates how far this machine's clock is ahead of the server's. Every message that says the server's time gives an
 * upper bound, offset plus time on the way; the smallest of the last minute counts. Latencies then leave out the fastest
 * trip.
 */
export class ClockOffset {
  readonly sameClock: boolean;
  private readonly recent = new History(TRUSTED_MS);

  constructor(hostname: string) {
    this.sameClock = LOCAL_HOSTS.has(hostname);
  }

  observe(serverTimeNs: number, receivedMs: number): void {
    this.recent.add({ timeMs: receivedMs, value: receivedMs - serverTimeNs / 1e6 });
  }

  /** What to subtract from this machine's time to get the server's. */
  get ms(): number {
    return this.sameClock ? 0 : (this.recent.quantile(0) ?? 0);
  }

  /** How the latency was measured, for people. */
  get label(): string {
    if (this.sameClock) return "capture to page, one clock";
    return `capture to page, clocks aligned by ${this.ms.toFixed(0)} ms (estimate)`;
  }
}
