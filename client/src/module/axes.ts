// Between Lightwell's axes (+Z up) and those of three.js (+Y up): (x, y, z) of Lightwell is (x, z, −y) of three.

import { SphericalHarmonics3, Vector3 } from "three";

import type { Coefficients } from "../sh.ts";

const HALF_ROOT_3 = Math.sqrt(3) / 2;

/** A point or direction of a +Y up page in Lightwell's axes. */
export function toLightwell({ x, y, z }: Vector3): [number, number, number] {
  return [x, -z, y];
}

/** A point or direction of Lightwell in a +Y up page. */
export function toThree([x, y, z]: readonly [number, number, number]): Vector3 {
  return new Vector3(x, z, -y);
}

/** The first nine coefficients, turned into the axes of a +Y up page, as three's `LightProbe` takes them. */
export function toSphericalHarmonics3(coefficients: Coefficients, yUp: boolean, target = new SphericalHarmonics3()): SphericalHarmonics3 {
  const at = (i: number) => new Vector3(coefficients[3 * i] ?? 0, coefficients[3 * i + 1] ?? 0, coefficients[3 * i + 2] ?? 0);
  const out = target.coefficients;
  for (let i = 0; i < 9; i++) out[i]!.copy(at(i));
  if (!yUp) return target;
  out[1]!.copy(at(2));
  out[2]!.copy(at(1)).negate();
  out[4]!.copy(at(7));
  out[5]!.copy(at(5)).negate();
  out[6]!.copy(at(6)).multiplyScalar(-0.5).addScaledVector(at(8), -HALF_ROOT_3);
  out[7]!.copy(at(4)).negate();
  out[8]!.copy(at(6)).multiplyScalar(-HALF_ROOT_3).addScaledVector(at(8), 0.5);
  return target;
}
