// Light beside a sample, from its gradient (MATHS §7.4): core/lightwell/gradients/extrapolate.py in TypeScript.

import type { Coefficients, Vector3 } from "../sh.ts";

/** Most that a step may change the mean radiance by, as a share of it: beyond, the step is cut short. */
export const LARGEST_CHANGE = 0.7;

/** Add `change` to `coefficients`, in place; cut short for each colour, so that its mean radiance keeps 30 %. */
export function addLimited(coefficients: Float64Array, change: Float64Array): void {
  for (let channel = 0; channel < 3; channel++) {
    const step = Math.abs(change[channel]!);
    const limit = LARGEST_CHANGE * Math.max(coefficients[channel]!, 0);
    const share = step > limit ? limit / step : 1;
    for (let i = channel; i < coefficients.length; i += 3) coefficients[i]! += share * change[i]!;
  }
}

/** Add `weight · G·step` to `sum`; `gradients` are `(bands², 3, 3)`: coefficient, channel, ∂/∂(x, y, z) per metre. */
export function addChange(sum: Float64Array, gradients: Coefficients, step: Vector3, weight: number): void {
  const [x, y, z] = [weight * step[0], weight * step[1], weight * step[2]];
  for (let i = 0, k = 0; i < sum.length; i++, k += 3) sum[i]! += gradients[k]! * x + gradients[k + 1]! * y + gradients[k + 2]! * z;
}

/** Read little-endian float32 gradients as they come over the wire; raises `RangeError` where they do not fit the coefficients. */
export function unpackGradients(bytes: Uint8Array, coefficients: number): Float32Array {
  if (bytes.byteLength !== 12 * coefficients) {
    throw new RangeError(`${bytes.byteLength} bytes of gradients for ${coefficients} coefficients; ${12 * coefficients} are needed`);
  }
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  return Float32Array.from({ length: 3 * coefficients }, (_, i) => view.getFloat32(4 * i, true));
}
