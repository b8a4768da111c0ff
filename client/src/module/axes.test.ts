// The turn into three's axes against the conformance vectors, which Python has written.

import { readFileSync } from "node:fs";

import { Vector3 } from "three";
import { describe, expect, it } from "vitest";

import { toLightwell, toSphericalHarmonics3, toThree } from "./axes.ts";

interface Vector {
  name: string;
  bands: number;
  input: number[][];
  output: number[][];
}

const file = new URL("../../../tests/vectors/three.json", import.meta.url);
const vectors = (JSON.parse(readFileSync(file, "utf-8")) as Vector[]).filter(({ bands }) => bands >= 3);

describe("axes of three.js", () => {
  it.each(vectors)("turns nine coefficients: $name", ({ input, output }) => {
    const turned = toSphericalHarmonics3(Float64Array.from(input.flat()), true).coefficients;
    turned.forEach((colour, i) => {
      colour.toArray().forEach((value, channel) => expect(value).toBeCloseTo(output[i]![channel]!, 6));
    });
  });

  it("leaves them where +Z is up", () => {
    const { input } = vectors[0]!;
    toSphericalHarmonics3(Float64Array.from(input.flat()), false).coefficients.forEach((colour, i) => {
      expect(colour.toArray()).toEqual(input[i]!.slice(0, 3));
    });
  });

  it("turns points there and back", () => {
    expect(toThree([0, 0, 1]).toArray()).toEqual([0, 1, -0]);
    expect(toLightwell(new Vector3(0, 1, 0))).toEqual([0, -0, 1]);
    expect(toThree(toLightwell(new Vector3(1, 2, 3))).toArray()).toEqual([1, 2, 3]);
  });
});
