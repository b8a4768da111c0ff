import { encode } from "@msgpack/msgpack";
import { afterEach, describe, expect, it, vi } from "vitest";

import { ClockOffset, nowMs } from "./clock.ts";
import { explain } from "./connection.ts";
import { LiveStream, lightOf, liveUrl, looksTheSame } from "./live.ts";
import { History, Rate } from "./rate.ts";
import { CLOSE_NOT_FOUND, CLOSE_UNAUTHORIZED, type Frame } from "./wire.ts";

afterEach(() => {
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

describe("address of a subscription", () => {
  it("stays beside the page, under any path and over TLS", () => {
    expect(liveUrl("http://127.0.0.1:8400/", "room", true, true)).toBe(
      "ws://127.0.0.1:8400/api/v1/streams/room/live?bands=5&backdrop=true&gradients=true",
    );
    expect(liveUrl("https://host/light/?token=a%2Bb#ev=1", "a/b", false, false)).toBe(
      "wss://host/light/api/v1/streams/a%2Fb/live?token=a%2Bb&bands=5&backdrop=false",
    );
  });
});

describe("closes", () => {
  it("are explained in words, and trying again is left to what may come back", () => {
    expect(explain(CLOSE_UNAUTHORIZED, "")).toEqual({ reason: expect.stringContaining("?token="), final: true });
    expect(explain(CLOSE_UNAUTHORIZED, "token expired").reason).toBe("token expired");
    expect(explain(CLOSE_NOT_FOUND, "there is no stream 'x'")).toEqual({ reason: "there is no stream 'x'", final: false });
    expect(explain(1006, "").final).toBe(false);
  });
});

describe("light that looks the same", () => {
  const frame = (changes: Partial<Frame> = {}): Frame =>
    ({
      seq: 1,
      coefficients: new Uint8Array(Float32Array.of(1, 2, 3).buffer),
      gradients: new Uint8Array(Float32Array.of(1, 2, 3, 4, 5, 6, 7, 8, 9).buffer),
      position: [0, 0, 1],
      trust_radius_m: 0.3,
      dominant: null,
      ...changes,
    }) as unknown as Frame;
  const same = (changes: Partial<Frame>): boolean => looksTheSame(lightOf(frame(), 1), lightOf(frame(changes), 2));

  it("is that of another time, and no other", () => {
    expect(same({ seq: 2, source_frame: "b" })).toBe(true);
    expect(same({ coefficients: new Uint8Array(Float32Array.of(1, 2, 4).buffer) })).toBe(false);
    expect(same({ gradients: null })).toBe(false);
    expect(same({ gradients: new Uint8Array(36) })).toBe(false);
    expect(same({ position: [0, 0, 2] })).toBe(false);
    expect(same({ position: null })).toBe(false);
    expect(same({ trust_radius_m: null })).toBe(false);
    expect(same({ dominant: { direction: [0, 0, 1], irradiance: [1, 1, 1], ambient: [0, 0, 0] } })).toBe(false);
  });
});

describe("following another stream", () => {
  class Socket {
    static newest: Socket;
    onmessage: (event: { data: Uint8Array }) => void = () => undefined;

    constructor() {
      Socket.newest = this;
    }

    close(): void {}
  }

  it("forgets the rate and the age of the one before", () => {
    vi.stubGlobal("WebSocket", Socket);
    const live = new LiveStream("http://127.0.0.1:8400/");
    live.follow("room");
    const frame = { type: "frame", capture_time_ns: 0, coefficients: new Uint8Array(12) };
    for (let i = 0; i < 10; i++) Socket.newest.onmessage({ data: encode(frame) });
    const timeMs = nowMs();
    expect(live.frames.perSecond(timeMs)).toBeGreaterThan(0);

    live.follow("hall");
    expect(live.frames.perSecond(timeMs)).toBe(0);
    expect(live.silentSeconds(timeMs + 1000)).toBe(0);
    expect(live.latencies.all()).toEqual([]);
  });
});

describe("time", () => {
  it("follows this machine's clock through sleep and corrections, and adds the timer's fraction", () => {
    const timer = vi.spyOn(performance, "now").mockReturnValue(1000.25);
    const clock = vi.spyOn(Date, "now").mockReturnValue(1_700_000_000_000);
    const before = nowMs();
    expect(before - 1_700_000_000_000).toBeGreaterThanOrEqual(0);
    expect(before - 1_700_000_000_000).toBeLessThanOrEqual(1);

    timer.mockReturnValue(1000.75);
    clock.mockReturnValue(Math.floor(before + 0.5));
    expect(nowMs()).toBeCloseTo(before + 0.5, 3);

    for (const setTo of [1_700_003_600_000, 1_699_999_999_000]) {
      clock.mockReturnValue(setTo);
      expect(Math.abs(nowMs() - setTo)).toBeLessThanOrEqual(1);
    }
  });
});

describe("clock", () => {
  it("is one clock on this machine", () => {
    const clock = new ClockOffset("127.0.0.1");
    clock.observe(5e9, 9000);
    expect(clock.ms).toBe(0);
    expect(clock.label).toContain("one clock");
  });

  it("keeps the smallest offset that a message showed", () => {
    const clock = new ClockOffset("elsewhere");
    expect(clock.ms).toBe(0);
    for (const [server, received] of [[1000, 1130], [2000, 2104], [3000, 3500]] as const) {
      clock.observe(server * 1e6, received);
    }
    expect(clock.ms).toBe(104);
    expect(clock.label).toContain("104 ms");
  });

  it("lets go of an offset that a corrected clock has made wrong", () => {
    const clock = new ClockOffset("elsewhere");
    clock.observe(0, 100);
    clock.observe(3_600_000 * 1e6, 3_600_250);
    expect(clock.ms).toBe(250);
  });
});

describe("rates", () => {
  it("count events of the last two seconds", () => {
    const rate = new Rate();
    expect(rate.perSecond(0)).toBe(0);
    for (let time = 0; time <= 4000; time += 50) rate.add(time);
    expect(rate.perSecond(4000)).toBe(20);
    expect(rate.perSecond(7000)).toBe(0);
  });

  it("tell quantiles of the latest samples and forget old ones", () => {
    const history = new History(1000);
    expect(history.quantile(0.5)).toBeNull();
    for (let i = 0; i < 100; i++) history.add({ timeMs: 20 * i, value: i });
    expect(history.quantile(0.5, 1900)).toBe(97);
    expect(history.all().every(({ timeMs }) => timeMs >= 700)).toBe(true);
  });
});
