// Light between samples against what Python says of it (tests/vectors/page).

import { readFileSync } from "node:fs";

import { describe, expect, it } from "vitest";

import { PAGE_BANDS, withBands, type Vector3 } from "../sh.ts";
import { unpackGradients } from "./extrapolate.ts";
import { LocalField } from "./local.ts";
import { NearLight, type Probe } from "./near.ts";
import { SampleSet, type Sample } from "./samples.ts";

interface Vectors {
  name: string;
  positions: Vector3[];
  coefficients: number[][];
  gradients: number[][];
  points: Vector3[];
  light: number[][];
  plain: number[][];
  /** Where samples 0, 3, … have no gradient. */
  partly: number[][];
}

const file = new URL("../../../tests/vectors/page/page.json", import.meta.url);
const { samples: vectors } = JSON.parse(readFileSync(file, "utf-8")) as { samples: Vectors[] };

function samplesOf({ positions, coefficients, gradients }: Vectors, has: (k: number) => boolean = () => true): Sample[] {
  return positions.map((position, k) => ({
    position,
    coefficients: Float64Array.from(coefficients[k]!),
    gradients: has(k) ? Float64Array.from(gradients[k]!) : null,
  }));
}

function expectClose(actual: ArrayLike<number>, expected: ArrayLike<number>, tolerance: number): void {
  expect(actual.length).toBe(expected.length);
  for (let i = 0; i < actual.length; i++) expect(Math.abs(actual[i]! - expected[i]!)).toBeLessThan(tolerance);
}

describe.each(vectors)("light of $name", (vector) => {
  it("is Python's, with gradients, without, and with some", () => {
    for (const [set, light] of [
      [new SampleSet(samplesOf(vector)), vector.light],
      [new SampleSet(samplesOf(vector, () => false)), vector.plain],
      [new SampleSet(samplesOf(vector, (k) => k % 3 !== 0)), vector.partly],
    ] as const) {
      vector.points.forEach((point, k) => expectClose(set.at(point), light[k]!, 1e-9));
    }
  });

  it("comes out of the lattice about an object", () => {
    const padded = samplesOf(vector).map(({ position, coefficients, gradients }) => ({
      position,
      coefficients: withBands(Float32Array.from(coefficients), PAGE_BANDS),
      gradients: new Float32Array(9 * PAGE_BANDS ** 2),
      original: gradients!,
    }));
    for (const { gradients, original } of padded) gradients.set(original);
    const set = new SampleSet(padded);
    const middle = vector.points[12]!;
    const base = Float32Array.from(set.at(middle));
    const local = new LocalField();
    local.fill(set, middle, 0.2, base, null);
    expectClose(local.field.sample(middle), base.map(() => 0), 1e-3);
    // At nodes to halves, between them where light bends and the limit has a kink as well as 7 cm steps can be.
    for (const [offset, tolerance] of [[[0.2 / 3, -0.4 / 3, 0.2], 2e-3], [[0.2, 0.2, -0.2], 2e-3], [[0.02, 0.07, -0.18], 0.03]] as const) {
      const point = middle.map((value, k) => value + offset[k]!) as unknown as Vector3;
      const found = local.field.sample(point).map((value, i) => value + base[i]!);
      expectClose(found, set.at(point), tolerance);
    }
  });
});

describe("one sample", () => {
  it("keeps 30 % of its mean, and a black channel stays as it is", () => {
    const gradients = Float64Array.from({ length: 18 }, (_, i) => (i < 9 ? -1 : 3));
    const set = new SampleSet([{ position: [1, 1, 1], coefficients: Float64Array.of(1, 0, 2, 5, 5, 5), gradients }]);
    expectClose(set.at([10, 1, 1]), [0.3, 0, 0.6, 7.1, 5, 9.2], 1e-12);
    expectClose(set.at([1, 1.1, 1]), [0.9, 0, 1.9, 5.3, 5, 5.3], 1e-12);
  });
});

describe("probes of different bands", () => {
  it("light with those that all have, as Python's do", () => {
    const probe = (bands: number, x: number) => ({
      name: String(x),
      position: [x, 0, 0] as Vector3,
      light: { coefficients: new Float32Array(3 * bands * bands).fill(2), gradients: new Float32Array(9 * bands * bands) },
    });
    const probes = [probe(2, 0), probe(4, 1)] as unknown as Probe[];
    const { illumination } = new NearLight().illuminate(probes, { middle: [0.5, 0, 0], radius: 0.1 }, true, null);
    expect([...illumination.distant!]).toEqual([...Array(12).fill(2), ...Array(3 * PAGE_BANDS ** 2 - 12).fill(0)]);
  });
});

describe("samples that make no set", () => {
  it("are refused", () => {
    const [sample] = samplesOf(vectors[0]!);
    expect(() => new SampleSet([])).toThrow(RangeError);
    expect(() => new SampleSet([sample!, sample!])).toThrow("share a place");
  });
});

describe("gradients on the wire", () => {
  it("are little-endian floats, nine a coefficient", () => {
    const bytes = new Uint8Array(new Float32Array(9).fill(0.5).buffer);
    expect([...unpackGradients(bytes, 3)]).toEqual(Array(9).fill(0.5));
    expect(() => unpackGradients(bytes, 12)).toThrow("36 bytes");
  });
});
