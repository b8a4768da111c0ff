// Rates and latencies over a short past.

/** Counts events and tells their rate over the last `windowMs`. */
export class Rate {
  private times: number[] = [];
  private firstMs: number | null = null;

  constructor(private readonly windowMs = 2000) {}

  add(timeMs: number): void {
    this.firstMs ??= timeMs;
    this.times.push(timeMs);
    this.forget(timeMs);
  }

  perSecond(timeMs: number): number {
    this.forget(timeMs);
    // In the first moments the span is what has passed, but never so short that one event looks like a storm.
    const span = Math.min(this.windowMs, Math.max(timeMs - (this.firstMs ?? timeMs), 500));
    return (1000 * this.times.length) / span;
  }

  clear(): void {
    this.times = [];
    this.firstMs = null;
  }

  private forget(timeMs: number): void {
    while (this.times.length > 0 && this.times[0]! <= timeMs - this.windowMs) this.times.shift();
  }
}

export interface Sample {
  timeMs: number;
  value: number;
}

/** The samples of the last `spanMs`. */
export class History {
  private samples: Sample[] = [];

  constructor(private readonly spanMs: number) {}

  add(sample: Sample): void {
    this.samples.push(sample);
    const oldest = sample.timeMs - this.spanMs;
    if (this.samples[0]!.timeMs < oldest - this.spanMs / 4) {
      this.samples = this.samples.filter(({ timeMs }) => timeMs >= oldest);
    }
  }

  all(): readonly Sample[] {
    return this.samples;
  }

  clear(): void {
    this.samples = [];
  }

  /** The value below which a share of the samples since `sinceMs` lies; `null` without samples. */
  quantile(share: number, sinceMs = -Infinity): number | null {
    const values = this.samples.filter(({ timeMs }) => timeMs >= sinceMs).map(({ value }) => value);
    values.sort((a, b) => a - b);
    return values[Math.min(values.length - 1, Math.floor(share * values.length))] ?? null;
  }
}
