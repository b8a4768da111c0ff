import { describe, expect, it } from "vitest";

import {
  bandsOf,
  basis,
  irradiance,
  lambertFactors,
  meanLuminance,
  phong,
  phongFactors,
  phongMoments,
  radiance,
  unpackCoefficients,
  withBands,
  type Vector3,
} from "./sh.ts";

/** Nearly even directions. */
function fibonacci(count: number): Vector3[] {
  return Array.from({ length: count }, (_, i) => {
    const z = 1 - (2 * i + 1) / count;
    const azimuth = Math.PI * (1 + Math.sqrt(5)) * i;
    const r = Math.sqrt(1 - z * z);
    return [r * Math.cos(azimuth), r * Math.sin(azimuth), z];
  });
}

function constant(bands: number): Float64Array {
  const coefficients = new Float64Array(3 * bands * bands);
  coefficients.fill(Math.sqrt(4 * Math.PI), 0, 3);
  return coefficients;
}

/** A distant light of irradiance 1 from `direction`. */
function distant(direction: Vector3, bands: number): Float64Array {
  return Float64Array.from([...basis(direction, bands)].flatMap((value) => [value, value, value]));
}

describe("basis", () => {
  it("has the published first nine functions", () => {
    const [x, y, z] = [0.36, 0.48, 0.8];
    const expected = [
      0.28209479,
      ...[y, z, x].map((value) => 0.48860251 * value),
      1.09254843 * x * y,
      1.09254843 * y * z,
      0.31539157 * (3 * z * z - 1),
      1.09254843 * x * z,
      0.54627422 * (x * x - y * y),
    ];
    basis([x, y, z], 3).forEach((value, i) => expect(value).toBeCloseTo(expected[i]!, 7));
  });

  it("obeys the addition theorem in every band, at the poles too", () => {
    for (const direction of [[0, 0, 1], [0, 0, -1], ...fibonacci(50)] as Vector3[]) {
      const values = basis(direction, 8);
      for (let l = 0; l < 8; l++) {
        const energy = values.subarray(l * l, (l + 1) * (l + 1)).reduce((sum, value) => sum + value * value, 0);
        expect(energy).toBeCloseTo((2 * l + 1) / (4 * Math.PI), 12);
      }
    }
  });

  it("is orthonormal", () => {
    const directions = fibonacci(20_000);
    const gram = new Float64Array(25 * 25);
    for (const direction of directions) {
      const values = basis(direction, 5);
      for (let i = 0; i < 25; i++) for (let j = 0; j < 25; j++) gram[25 * i + j]! += values[i]! * values[j]!;
    }
    for (let i = 0; i < 25; i++) {
      for (let j = 0; j < 25; j++) {
        expect((gram[25 * i + j]! * 4 * Math.PI) / directions.length).toBeCloseTo(i === j ? 1 : 0, 3);
      }
    }
  });
});

describe("lobes", () => {
  it("has Lambert's factors", () => {
    const expected = [Math.PI, (2 * Math.PI) / 3, Math.PI / 4, 0, -Math.PI / 24, 0, Math.PI / 64, 0, -Math.PI / 128];
    lambertFactors(9).forEach((factor, l) => expect(factor).toBeCloseTo(expected[l]!, 14));
  });

  it("agrees with quadrature for any exponent", () => {
    for (const exponent of [0, 1, 2.5, 6, 20]) {
      const legendre = [1, 0, 0, 0, 0];
      const sums = [0, 0, 0, 0, 0];
      const steps = 20_000;
      for (let i = 0; i < steps; i++) {
        const u = (i + 0.5) / steps;
        legendre[1] = u;
        for (let l = 2; l < 5; l++) legendre[l] = ((2 * l - 1) * u * legendre[l - 1]! - (l - 1) * legendre[l - 2]!) / l;
        for (let l = 0; l < 5; l++) sums[l]! += (u ** exponent * legendre[l]!) / steps;
      }
      phongMoments(exponent, 5).forEach((moment, l) => expect(moment).toBeCloseTo(sums[l]!, 7));
    }
  });

  it("keeps the mean of the light", () => {
    for (const exponent of [1, 7.3, 64]) expect(phongFactors(exponent, 5)[0]).toBeCloseTo(1, 15);
  });
});

describe("shading", () => {
  it("gives π and 1 under constant light", () => {
    for (const direction of fibonacci(10)) {
      for (const value of irradiance(constant(5), direction)) expect(value).toBeCloseTo(Math.PI, 6);
      for (const value of phong(constant(5), direction, 12)) expect(value).toBeCloseTo(1, 6);
    }
  });

  it("has the known minimum −19/480 of a distant light in three bands", () => {
    const light = distant([0, 0, 1], 3);
    const cosine = -8 / 15;
    expect(irradiance(light, [Math.sqrt(1 - cosine * cosine), 0, cosine])[0]).toBeCloseTo(-19 / 480, 7);
    const lowest = Math.min(...fibonacci(5000).map((normal) => irradiance(light, normal)[0]));
    expect(lowest).toBeGreaterThan(-19 / 480 - 1e-6);
  });

  it("makes π(1 + n_z)/2 of the half-space light", () => {
    const light = new Float64Array(75);
    for (const [index, value] of [[0, 1.7724538509], [2, 1.5349900619], [12, -0.5861840125]] as const) {
      light.fill(value, 3 * index, 3 * index + 3);
    }
    for (const normal of fibonacci(20)) {
      expect(irradiance(light, normal)[1]).toBeCloseTo((Math.PI * (1 + normal[2])) / 2, 6);
    }
  });

  it("points to the light", () => {
    const direction: Vector3 = [0.48, -0.6, 0.64];
    const light = distant(direction, 5);
    const towards = radiance(light, direction)[0];
    for (const other of fibonacci(500)) expect(radiance(light, other)[0]).toBeLessThanOrEqual(towards + 1e-12);
  });
});

describe("packing", () => {
  it("reads little-endian float32 at any byte offset", () => {
    const bytes = new Uint8Array(1 + 12);
    const view = new DataView(bytes.buffer, 1);
    [1.5, -2.25, 3e-8].forEach((value, i) => view.setFloat32(4 * i, value, true));
    expect([...unpackCoefficients(bytes.subarray(1))]).toEqual([1.5, -2.25, Math.fround(3e-8)]);
  });

  it("refuses what is no whole number of bands", () => {
    expect(() => unpackCoefficients(new Uint8Array(13))).toThrow(RangeError);
    expect(() => bandsOf(new Float32Array(6))).toThrow(RangeError);
    expect(() => bandsOf(new Float32Array(0))).toThrow(RangeError);
  });

  it("truncates and fills up", () => {
    expect(withBands(Float32Array.from({ length: 12 }, (_, i) => i), 1)).toEqual(Float32Array.of(0, 1, 2));
    expect(withBands(Float32Array.of(1, 2, 3), 2).length).toBe(12);
    expect(meanLuminance(constant(2))).toBeCloseTo(1, 12);
  });
});
