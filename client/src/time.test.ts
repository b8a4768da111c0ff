import { describe, expect, it } from "vitest";

import { LiveStream, type Light } from "./live.ts";
import { TimeTravel, paused, timeline, type Shower } from "./time.ts";
import type { Frame } from "./wire.ts";

function light(receivedMs: number): Light {
  const coefficients = new Float32Array(75).fill(receivedMs / 1000);
  return { frame: { seq: receivedMs / 100 } as Frame, coefficients, gradients: null, receivedMs };
}

class Picture implements Shower {
  paused = false;
  shown: Light | null = null;
  held: Light | null = null;

  setTime(held: Light | null): void {
    this.held = held;
  }
}

function tenSeconds(): { travel: TimeTravel; shower: Picture; live: LiveStream } {
  const live = new LiveStream("http://127.0.0.1/");
  live.past = Array.from({ length: 101 }, (_, index) => light(1e6 + 100 * index));
  const shower = new Picture();
  shower.shown = live.past.at(-1)!;
  return { live, shower, travel: new TimeTravel(live, shower) };
}

const NOW = 1e6 + 10_000;

describe("time", () => {
  it("follows the newest light, and tells how far one can go back", () => {
    const { travel, shower } = tenSeconds();
    travel.refresh(NOW);
    expect(timeline.value.span).toBeCloseTo(10);
    expect(timeline.value.back).toBe(0);
    expect(timeline.value.levels[0]![0]).toBeCloseTo(10);
    expect(timeline.value.levels.at(-1)).toEqual([0, expect.closeTo(1010, 0)]);
    expect(shower.paused).toBe(false);
  });

  it("goes back to what was, which stays while the stream goes on", () => {
    const { travel, shower, live } = tenSeconds();
    travel.seek(4, NOW);
    expect(paused.value && shower.paused).toBe(true);
    expect(shower.held?.receivedMs).toBe(NOW - 4000);
    live.past = [light(NOW + 60_000)];
    travel.refresh(NOW + 60_000);
    expect(timeline.value.back).toBeCloseTo(4);
    travel.step(-2, NOW + 60_000);
    expect(shower.held?.receivedMs).toBe(NOW - 4200);
    travel.step(1000, NOW + 60_000);
    expect(shower.held?.receivedMs).toBe(NOW);

    travel.toggle(NOW + 60_000);
    expect(paused.value || shower.paused).toBe(false);
    expect(shower.held).toBeNull();
  });

  it("pauses where there is no light yet", () => {
    const { travel, live, shower } = tenSeconds();
    live.past = [];
    shower.shown = null;
    travel.step(-1, NOW);
    travel.seek(3, NOW);
    expect(shower.held).toBeNull();
    expect(timeline.value).toEqual({ levels: [], back: 0, span: 0 });
    travel.follow(NOW);
  });

  it("forgets what is older than half a minute", () => {
    const { live } = tenSeconds();
    live.updatePast(NOW + 25_000);
    expect(live.past[0]!.receivedMs).toBeGreaterThan(NOW - 5000);
  });
});
