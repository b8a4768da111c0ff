// The page's mathematics against figures that Python has written (tests/vectors/page).

import { readFileSync } from "node:fs";

import { describe, expect, it } from "vitest";

import { Atlas } from "./grid/atlas.ts";
import { Field } from "./grid/field.ts";
import { illuminate, middleOf } from "./grid/illuminate.ts";
import { BrickLattice, RegularLattice } from "./grid/lattice.ts";
import { atlasLayout, tileCount } from "./grid/layout.ts";
import { arrange, arrangeBends, describeGrid } from "./grid/load.ts";
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

/** A grid whose samples are those of its gradients' half rule, or of its bricks. */
interface FineVectors {
  name: string;
  attributes: Record<string, unknown>;
  tiles: number[][];
  bends: number[][];
  pages: number[];
  levels: number[];
  points: Vector3[];
  samples: number[][][];
}

interface GroupVectors {
  name: string;
  groups: number[][];
  live: number[];
  gains: number[][];
  method: string;
  residual: number;
  rest: number[];
}

interface Vectors {
  grids: GridVectors[];
  bent: FineVectors[];
  adaptive: FineVectors[];
  groups: GroupVectors[];
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
  const lattice = new RegularLattice(info);
  const tiles = grid.tiles.map((tile) => Uint16Array.from(tile));
  const stored = Math.min(grid.bands, 5);
  // As `loadField` does with more bands than the page draws: the last coefficient in a tile of its own.
  if (grid.bands > 5) {
    const [red, green, blue] = tiles.slice(18, 21) as [Uint16Array, Uint16Array, Uint16Array];
    const last = red.map((_, i) => [red[i]!, green[i - 1] ?? 0, blue[i - 2] ?? 0, 0][i % 4]!);
    return new Field(info, stored, lattice, new Atlas(arrange(info, LIMITS), lattice.tile, [...tiles.slice(0, 18), last]), null);
  }
  return new Field(info, stored, lattice, new Atlas(arrange(info, LIMITS), lattice.tile, tiles), null);
}

function fineFieldOf({ attributes, tiles, bends, pages, levels }: FineVectors): Field {
  const info = describeGrid("test.grid", attributes);
  const lattice = info.slots === null ? new RegularLattice(info) : new BrickLattice(info, Int32Array.from(pages), Uint8Array.from(levels));
  const atlas = (layout: ReturnType<typeof arrange>, halves: number[][]) =>
    new Atlas(layout, lattice.tile, halves.map((tile) => Uint16Array.from(tile)));
  const bendLayout = arrangeBends(info, LIMITS);
  return new Field(info, info.bands, lattice, atlas(arrange(info, LIMITS), tiles), bendLayout && atlas(bendLayout, bends));
}

const circumstances = (place: Vector3) => ({ place, probe: place, gradients: true, before: null });

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
    const middle = middleOf(grid);
    const { gains, residual, rest, method } = modulate(live, [withBands(field.sample(middle), 5)]);
    expectClose(gains[0]!, grid.gain);
    expect(residual).toBeCloseTo(grid.residual, 5);
    expectClose(rest!, grid.rest.flat());
    expect(method).toBe("gain");
    const lighting = illuminate("both", live, [field], circumstances(middle))!;
    // Where the probe stands, the light is the probe's.
    expectClose(lighting.illumination.surround, [...live]);
  });

  it.each([...vectors.bent, ...vectors.adaptive])("is looked up as by Python: $name", (grid) => {
    const field = fineFieldOf(grid);
    // Each half of an atlas is rounded by itself.
    grid.points.forEach((point, i) => expectClose(field.sample(point), grid.samples[i]!.flat(), 3e-6));
    const bends = grid.points.some((point) => field.sample(point).some((value, i) => value !== field.sample(point, false)[i]));
    expect(bends).toBe(field.bends !== null);
  });

  it("is left as it is by its own light, and dimmed by its own light dimmed", () => {
    const field = fieldOf(vectors.grids[0]!);
    const own = field.sample([0.5, 1, 0.25]);
    const { gains, residual, method, rest } = modulate(own.map((value) => 0.25 * value), [own]);
    expectClose(gains[0]!, [0.25, 0.25, 0.25]);
    expect(residual).toBeLessThan(1e-6);
    expect(method).toBe("gain");
    expect(rest).toBeNull();
  });

  it("gives no gain where the field is black, and no negative one", () => {
    const black = new Float32Array(75);
    const live = Float32Array.from({ length: 75 }, (_, i) => i + 1);
    expect(modulate(live, [black]).gains).toEqual([[0, 0, 0]]);
    expect([...modulate(live, [black]).rest!]).toEqual([...live]);
    expect(modulate(live, [live.map((value) => -value)]).gains).toEqual([[0, 0, 0]]);
    expect(modulate(black, [live]).residual).toBe(0);
  });

  it("waits for the light that it needs", () => {
    const field = fieldOf(vectors.grids[0]!);
    const live = new Float32Array(75).fill(1);
    const here = circumstances([0, 1, 0]);
    expect(illuminate("stream", null, [field], here)).toBeNull();
    expect(illuminate("grid", live, [], here)).toBeNull();
    expect(illuminate("both", null, [field], here)!.modulation).toBeNull();
    expect(illuminate("stream", live, [], here)!.illumination.fields).toEqual([]);
  });

  it("that cannot be drawn is refused in words", () => {
    const good = vectors.grids[0]!;
    expect(() => describeGrid("a.other", { format: "lightwell.other.v1" })).toThrow("no grid");
    expect(() => describeGrid("a.adaptive", { format: "lightwell.adaptive-grid.v1", resolution: [2, 2, 2] })).toThrow("gpu_slots is missing");
    expect(() => describeGrid("a.grid", { format: "lightwell.grid.v1" })).toThrow("resolution is missing");
    const deep = infoOf({ ...good, resolution: [8, 8, 3000] });
    expect(() => arrange(deep, LIMITS)).toThrow("at most 2048 texels");
    const large = infoOf({ ...good, resolution: [256, 256, 256] });
    expect(() => arrange(large, LIMITS)).toThrow("2432 MiB");
    const bricks = vectors.adaptive[0]!;
    const info = describeGrid("a.adaptive", bricks.attributes);
    const damaged = Int32Array.from(bricks.pages).fill(bricks.levels.length);
    expect(() => new BrickLattice(info, damaged, Uint8Array.from(bricks.levels))).toThrow("do not fit each other");
  });

  it("is drawn without its gradients where these are too large", () => {
    const info = { ...infoOf({ ...vectors.grids[0]!, resolution: [128, 128, 128] }), bendScale: 1 };
    expect(arrange(info, LIMITS).size).toEqual([512, 640, 128]);
    expect(arrangeBends(info, LIMITS)).toBeNull();
    expect(arrangeBends(info, { ...LIMITS, bytes: 2 ** 32 })!.size).toEqual([768, 1280, 128]);
  });
});

describe("light groups", () => {
  it.each(vectors.groups)("have the gains that Python finds: $name", ({ groups, live, gains, method, residual, rest }) => {
    const found = modulate(
      Float32Array.from(live),
      groups.map((group) => Float32Array.from(group)),
    );
    expect(found.method).toBe(method);
    expect(found.residual).toBeCloseTo(residual, 5);
    found.gains.forEach((gain, k) => gain.forEach((value, c) => expect(value).toBeCloseTo(gains[k]![c]!, 4)));
    const size = Math.max(...live.map(Math.abs), 1e-6);
    rest.forEach((value, i) => expect(Math.abs((found.rest?.[i] ?? 0) - value) / size).toBeLessThan(1e-5));
  });

  it("keep their gains a little beyond the limit, so that noise does not make the light flicker", () => {
    const [one, other] = vectors.groups[0]!.groups.map((group) => Float32Array.from(group)) as [Float32Array, Float32Array];
    const strange = one.map((_, i) => Math.sin(7.3 * i));
    let size = 0;
    const near = () => one.map((value, i) => value + 0.5 * other[i]! + size * strange[i]!);
    while (modulate(near(), [one, other]).method === "groups") size += 0.001;
    const live = near();
    expect(modulate(live, [one, other], "groups").method).toBe("groups");
    expect(modulate(live, [one, other], "gain").method).toBe("gain");
    size *= 2;
    expect(modulate(near(), [one, other], "groups").method).toBe("gain");
  });

  it("add up where there is no live light, and are black together with none", () => {
    const [one, other] = [vectors.grids[0]!, vectors.grids[2]!].map(fieldOf) as [Field, Field];
    const place: Vector3 = [0.4, 1, 0.2];
    const { illumination } = illuminate("grid", null, [one, other], circumstances(place))!;
    const [first, second] = [one, other].map((field) => withBands(field.sample(place), 5));
    expectClose(illumination.surround, [...first!].map((value, i) => value + second![i]!));
    expect(illumination.fields.map(({ gain }) => gain)).toEqual([[1, 1, 1], [1, 1, 1]]);
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
