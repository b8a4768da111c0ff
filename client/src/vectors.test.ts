// The conformance vectors that the Python tests use too.

import { readFileSync, readdirSync } from "node:fs";

import { describe, expect, it } from "vitest";

import { bandsOf, irradiance, radiance, type Vector3 } from "./sh.ts";

interface Vector {
  name: string;
  convention: string;
  bands: number;
  input: number[][];
  output: number[][];
  /** `irradiance` is that of three bands, as engines have it. */
  evaluations: { world: Vector3; engine: Vector3; radiance: number[]; irradiance: number[] }[];
}

const folder = new URL("../../tests/vectors/", import.meta.url);
// Those of gradients are of their conversion to other conventions, which the page does not do.
const files = readdirSync(folder).filter((file) => file.endsWith(".json") && file !== "gradients.json");

describe("conformance vectors", () => {
  it("are there", () => expect(files.length).toBeGreaterThanOrEqual(5));

  for (const file of files) {
    const vectors = JSON.parse(readFileSync(new URL(file, folder), "utf-8")) as Vector[];
    it.each(vectors)(`${file}: $name, $bands bands`, ({ convention, bands, input, output, evaluations }) => {
      const coefficients = Float64Array.from(input.flat());
      expect(bandsOf(coefficients)).toBe(bands);
      const tolerance = 1e-6 * Math.max(...coefficients.map(Math.abs), 1);
      const expectClose = (actual: number[], expected: number[]) => {
        actual.forEach((value, channel) => expect(Math.abs(value - expected[channel]!)).toBeLessThan(tolerance));
      };
      expect(evaluations.length).toBeGreaterThan(0);
      for (const expected of evaluations) {
        expectClose(radiance(coefficients, expected.world), expected.radiance);
        expectClose(irradiance(coefficients.subarray(0, 27), expected.world), expected.irradiance);
        // three.js has our basis in its own axes.
        if (convention === "three") {
          expectClose(radiance(Float64Array.from(output.flat()), expected.engine), expected.radiance);
        }
      }
    });
  }
});
