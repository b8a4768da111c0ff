// The server stamps frames with its clock, the page reads its own. On one machine they are the same clock.

/** Milliseconds since the Unix epoch, with the resolution of the performance timer. */
export function nowMs(): number {
  return performance.timeOrigin + performance.now();
}

const LOCAL_HOSTS = new Set(["localhost", "127.0.0.1", "[::1]"]);

/**
 * Estimates how far this machine's clock is ahead of the server's. Every message that says the server's time gives an
 * upper bound, offset plus time on the way; the smallest one is kept. Latencies then leave out the fastest trip.
 */
export class ClockOffset {
  readonly sameClock: boolean;
  private smallestMs = Infinity;

  constructor(hostname: string) {
    this.sameClock = LOCAL_HOSTS.has(hostname);
  }

  observe(serverTimeNs: number, receivedMs: number): void {
    this.smallestMs = Math.min(this.smallestMs, receivedMs - serverTimeNs / 1e6);
  }

  /** What to subtract from this machine's time to get the server's. */
  get ms(): number {
    return this.sameClock || this.smallestMs === Infinity ? 0 : this.smallestMs;
  }

  /** How the latency was measured, for people. */
  get label(): string {
    if (this.sameClock) return "capture to page, one clock";
    return `capture to page, clocks aligned by ${this.ms.toFixed(0)} ms (estimate)`;
  }
}
