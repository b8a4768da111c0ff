import { describe, expect, it } from "vitest";

import { ago, baseName, bytes, count, duration, point } from "./words.ts";

describe("numbers for people", () => {
  it("say times", () => {
    expect([0.04, 0.5, 3.4, 59.6, 75, 120, 3600, 5400].map(duration)).toEqual(
      ["0.0 s", "0.5 s", "3 s", "1 min", "1 min 15 s", "2 min", "1 h", "1 h 30 min"],
    );
    expect(ago(1000e9, 1_003_000)).toBe("just now");
    expect(ago(1000e9, 1_300_000)).toBe("5 min ago");
  });

  it("say sizes, counts and places", () => {
    expect([12, 999, 1500, 12_400_000, 999_999].map(bytes)).toEqual(["12 B", "999 B", "1.5 kB", "12 MB", "1.0 MB"]);
    expect([0.25, 3, 3.25, 12_345, 4.2e6].map(count)).toEqual(["0.25", "3", "3.3", "12 k", "4.2 M"]);
    expect(point([0.1234, -1, 2.5])).toBe("0.12, -1, 2.5");
    expect(point([-0.001])).toBe("0");
    expect(baseName("/data/captures/stage/")).toBe("stage");
  });
});
