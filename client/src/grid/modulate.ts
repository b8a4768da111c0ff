// A static field modulated by a live probe (MATHS §11d): what the probe sees now against what the field holds at the
// probe's place says how the light has changed everywhere.

import { PAGE_BANDS, lambertFactors, type Coefficients, type Vector3 } from "../sh.ts";

export interface Modulation {
  /** What the field is multiplied with, a channel. */
  gain: Vector3;
  /** Share of the live light, by irradiance, that no gain of the field explains: 0 … 1 and above. */
  residual: number;
  /** `gain`: the field times the gain is all; `gain+residual`: the rest is added as distant light. */
  method: "gain" | "gain+residual";
  /** Coefficients that are added to the field everywhere, `(bands², 3)`. */
  rest: Float32Array;
}

/** Below this share the rest is noise and calibration, and is left out. */
const NEGLIGIBLE = 0.01;

/**
 * Method 2 of MATHS §11d: `g = ⟨ℓ, b⟩ / ⟨b, b⟩` for each channel, weighted by `A_l²`, and the rest `ℓ − g b`. It is exact
 * at the probe's place. A channel in which the field is black there gets no gain: all of its light is rest.
 */
export function modulate(live: Coefficients, field: Coefficients): Modulation {
  const factors = lambertFactors(PAGE_BANDS);
  const count = Math.min(live.length, field.length) / 3;
  const gain: [number, number, number] = [0, 0, 0];
  const rest = new Float32Array(live.length);
  let left = 0;
  let all = 0;
  for (let channel = 0; channel < 3; channel++) {
    let across = 0;
    let square = 0;
    for (let i = 0; i < count; i++) {
      const weight = (factors[Math.floor(Math.sqrt(i))] ?? 0) ** 2;
      across += weight * live[3 * i + channel]! * field[3 * i + channel]!;
      square += weight * field[3 * i + channel]! ** 2;
    }
    // A negative gain would turn the field inside out.
    gain[channel] = square > 0 ? Math.max(0, across / square) : 0;
    for (let i = 0; i < live.length / 3; i++) {
      const value = live[3 * i + channel]!;
      const difference = value - gain[channel]! * (i < count ? field[3 * i + channel]! : 0);
      const weight = (factors[Math.floor(Math.sqrt(i))] ?? 0) ** 2;
      rest[3 * i + channel] = difference;
      left += weight * difference ** 2;
      all += weight * value ** 2;
    }
  }
  const residual = all > 0 ? Math.sqrt(left / all) : 0;
  const method = residual < NEGLIGIBLE ? "gain" : "gain+residual";
  if (method === "gain") rest.fill(0);
  return { gain, residual, method, rest };
}
