// The page's mathematics against figures that Python has written (tests/vectors/page).

import { readFileSync } from "node:fs";

import { describe, expect, it } from "vitest";

import { Field, arrange, describeGrid } from "./grid/field.ts";
import { illuminate } from "./grid/illuminate.ts";
import { atlasLayout, tileCount } from "./grid/layout.ts";
import { modulate } from "./grid/modulate.ts";
import { samplePlaces } from "./grid/volume.ts";
import { irradiance, phong, phongFactors, phongTruncation, withBands, type Vector3 } from "./sh.ts";

interface GridVectors {
  name: string;
  bands: number;
  lower: Vector3;
  upper: Vector3;
  resolution: Vector3;
  scale: number;
  tiles: number[][];
  points: Vector3[];
  samples: number[][][];
  live: number[][];
  gain: number[];
  residual: number;
  rest: number[][];
}

interface Vectors {
  grids: GridVectors[];
  lobes: { exponent: number; bands: number; factors: number[]; error: number }[];
  shading: {
    exponent: number;
    coefficients: number[][];
    normals: Vector3[];
    views: Vector3[];
    irradiance: number[][];
    lobe: number[][];
  }[];
}

const vectors = JSON.parse(readFileSync(new URL("../../tests/vectors/page/page.json", import.meta.url), "utf-8")) as Vectors;
const LIMITS = { largest: 2048, bytes: 2 ** 30 };

function infoOf({ bands, lower, upper, resolution, scale }: GridVectors) {
  const attributes = {
    format: "lightwell.grid.v1",
    lower_m: lower,
    upper_m: upper,
    resolution,
    bands,
    gpu_tiles_scale: scale,
  };
  return describeGrid("test.grid", attributes);
}

function fieldOf(grid: GridVectors): Field {
  const info = infoOf(grid);
  const tiles = grid.tiles.map((tile) => Uint16Array.from(tile));
  const stored = Math.min(grid.bands, 5);
  // As `loadField` does with more bands than the page draws: the last coefficient in a tile of its own.
  if (grid.bands > 5) {
    const [red, green, blue] = tiles.slice(18, 21) as [Uint16Array, Uint16Array, Uint16Array];
    const last = red.map((_, i) => [red[i]!, green[i - 1] ?? 0, blue[i - 2] ?? 0, 0][i % 4]!);
    return new Field(info, stored, arrange(info, LIMITS), [...tiles.slice(0, 18), last]);
  }
  return new Field(info, stored, arrange(info, LIMITS), tiles);
}

function expectClose(actual: ArrayLike<number>, expected: number[], tolerance = 2e-6): void {
  expect(actual.length).toBe(expected.length);
  const size = Math.max(1e-6, ...expected.map(Math.abs));
  expected.forEach((value, i) => expect(Math.abs(actual[i]! - value) / size).toBeLessThan(tolerance));
}

describe("a grid", () => {
  it.each(vectors.grids)("is looked up as by Python: $name", (grid) => {
    const field = fieldOf(grid);
    grid.points.forEach((point, i) => {
      const expected = grid.samples[i]!.slice(0, field.stored ** 2).flat();
      expectClose(field.sample(point), expected);
    });
  });

  it.each(vectors.grids)("is modulated as by Python: $name", (grid) => {
    const field = fieldOf(grid);
    const live = Float32Array.from(grid.live.flat());
    const middle = grid.lower.map((low, k) => (low + grid.upper[k]!) / 2) as unknown as Vector3;
    const { gain, residual, rest, method } = modulate(live, withBands(field.sample(middle), 5));
    expectClose(gain, grid.gain);
    expect(residual).toBeCloseTo(grid.residual, 5);
    expectClose(rest, grid.rest.flat());
    expect(method).toBe("gain+residual");
    const lighting = illuminate("both", live, field, middle)!;
    // Where the probe stands, the light is the probe's.
    expectClose(lighting.illumination.surround, [...live]);
  });

  it("is left as it is by its own light, and dimmed by its own light dimmed", () => {
    const field = fieldOf(vectors.grids[0]!);
    const own = field.sample([0.5, 1, 0.25]);
    const { gain, residual, method, rest } = modulate(own.map((value) => 0.25 * value), own);
    expectClose(gain, [0.25, 0.25, 0.25]);
    expect(residual).toBeLessThan(1e-6);
    expect(method).toBe("gain");
    expect([...rest]).toEqual(Array(75).fill(0));
  });

  it("gives no gain where the field is black, and no negative one", () => {
    const black = new Float32Array(75);
    const live = Float32Array.from({ length: 75 }, (_, i) => i + 1);
    expect(modulate(live, black).gain).toEqual([0, 0, 0]);
    expect([...modulate(live, black).rest]).toEqual([...live]);
    expect(modulate(live, live.map((value) => -value)).gain).toEqual([0, 0, 0]);
    expect(modulate(black, live).residual).toBe(0);
  });

  it("waits for the light that it needs", () => {
    const field = fieldOf(vectors.grids[0]!);
    const live = new Float32Array(75).fill(1);
    expect(illuminate("stream", null, field, [0, 1, 0])).toBeNull();
    expect(illuminate("grid", live, null, [0, 1, 0])).toBeNull();
    expect(illuminate("both", null, field, [0, 1, 0])!.modulation).toBeNull();
    expect(illuminate("stream", live, null, [0, 1, 0])!.illumination.field).toBeNull();
  });

  it("that cannot be drawn is refused in words", () => {
    const good = vectors.grids[0]!;
    expect(() => describeGrid("a.adaptive", { format: "lightwell.adaptive.v1" })).toThrow("Open the regular grid");
    expect(() => describeGrid("a.grid", { format: "lightwell.grid.v1" })).toThrow("resolution is missing");
    const deep = infoOf({ ...good, resolution: [8, 8, 3000] });
    expect(() => arrange(deep, LIMITS)).toThrow("at most 2048 texels");
    const large = infoOf({ ...good, resolution: [256, 256, 256] });
    expect(() => arrange(large, LIMITS)).toThrow("2432 MiB");
  });
});

describe("an atlas", () => {
  it("holds all tiles with little waste, within the limits", () => {
    for (const bands of [1, 2, 3, 4, 5]) {
      for (const resolution of [[64, 64, 64], [5, 1, 9], [200, 10, 3], [1, 300, 2]] as Vector3[]) {
        const tiles = tileCount(bands);
        const { columns, rows, size } = atlasLayout(resolution, tiles, 2048)!;
        expect(columns * rows).toBeGreaterThanOrEqual(tiles);
        expect(columns * rows).toBeLessThanOrEqual(tiles + 3);
        expect(Math.max(...size)).toBeLessThanOrEqual(2048);
      }
    }
    expect(atlasLayout([64, 64, 64], 19, 2048)).toEqual({ columns: 4, rows: 5, size: [256, 320, 64] });
  });

  it("says where nothing fits", () => {
    expect(atlasLayout([1000, 1000, 2], 19, 2048)).toBeNull();
    expect(atlasLayout([2, 2, 2049], 1, 2048)).toBeNull();
  });
});

describe("sample spheres", () => {
  it("stand on the slice, within the box, apart from each other", () => {
    const grid = infoOf(vectors.grids[0]!);
    for (const axis of ["x", "y", "z"] as const) {
      const { places, radius } = samplePlaces({ ...grid, resolution: [32, 32, 32] }, axis, 0.25);
      const k = "xyz".indexOf(axis);
      expect(places.length).toBeLessThanOrEqual(144);
      for (const [i, place] of places.entries()) {
        expect(place[k]).toBeCloseTo(grid.lower[k]! + 0.25 * (grid.upper[k]! - grid.lower[k]!), 6);
        place.forEach((value, j) => expect(value >= grid.lower[j]! && value <= grid.upper[j]!).toBe(true));
        for (const other of places.slice(0, i)) {
          expect(Math.hypot(...place.map((value, j) => value - other[j]!))).toBeGreaterThan(2 * radius);
        }
      }
    }
  });
});

describe("shading", () => {
  it.each(vectors.lobes)("cuts a lobe of exponent $exponent off after $bands bands as Python does", ({ exponent, bands, factors, error }) => {
    expectClose(phongFactors(exponent, bands), factors);
    expect(phongTruncation(exponent, bands)).toBeCloseTo(error, 3);
  });

  it.each(vectors.shading)("agrees with Python at exponent $exponent", (row) => {
    const coefficients = Float64Array.from(row.coefficients.flat());
    row.normals.forEach((normal, i) => {
      const view = row.views[i]!;
      const across = 2 * view.reduce((sum, value, k) => sum + value * normal[k]!, 0);
      const reflected = view.map((value, k) => value - across * normal[k]!) as unknown as Vector3;
      expectClose(irradiance(coefficients, normal), row.irradiance[i]!);
      expectClose(phong(coefficients, reflected, row.exponent), row.lobe[i]!);
    });
  });
});
