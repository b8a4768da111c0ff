// The conformance vectors that the Python tests use too.

import { readFileSync, readdirSync } from "node:fs";

import { describe, expect, it } from "vitest";

import { bandsOf, irradiance, radiance, type Vector3 } from "./sh.ts";

interface Vector {
  name: string;
  convention: string;
  bands: number;
  input: number[][];
  evaluations: { world: Vector3; radiance: number[]; irradiance: number[] }[];
}

const folder = new URL("../../tests/vectors/", import.meta.url);
const files = readdirSync(folder).filter((file) => file.endsWith(".json"));

describe("conformance vectors", () => {
  it("are there", () => expect(files.length).toBeGreaterThanOrEqual(5));

  for (const file of files) {
    const vectors = JSON.parse(readFileSync(new URL(file, folder), "utf-8")) as Vector[];
    it.each(vectors)(`${file}: $name, $bands bands`, ({ bands, input, evaluations }) => {
      const coefficients = Float64Array.from(input.flat());
      expect(bandsOf(coefficients)).toBe(bands);
      const scale = Math.max(...coefficients.map(Math.abs), 1);
      expect(evaluations.length).toBeGreaterThan(0);
      for (const { world, ...expected } of evaluations) {
        radiance(coefficients, world).forEach((value, channel) => {
          expect(Math.abs(value - expected.radiance[channel]!)).toBeLessThan(1e-12 * scale);
        });
        irradiance(coefficients, world).forEach((value, channel) => {
          expect(Math.abs(value - expected.irradiance[channel]!)).toBeLessThan(1e-6 * scale);
        });
      }
    });
  }
});
