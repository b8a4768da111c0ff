// Which light is drawn: the stream's, the grid's, or the grid's as the stream changes it.

import type { Illumination } from "../materials.ts";
import { PAGE_BANDS, withBands, type Vector3 } from "../sh.ts";
import type { LightSource } from "../view.ts";
import type { Field } from "./field.ts";
import { modulate, type Method, type Modulation } from "./modulate.ts";

export interface Lighting {
  illumination: Illumination;
  modulation: Modulation | null;
}

/** What the light of grids depends on besides themselves. */
export interface Circumstances {
  /** Where the object is: what surrounds it there stands behind the picture and is what the exposure is metered on. */
  place: Vector3;
  /** Where the live probe stands. */
  probe: Vector3;
  /** Whether gradients are used, where a grid has them. */
  gradients: boolean;
  /** How the live light changed the grids a moment before. */
  before: Method | null;
}

const UNIT: Vector3 = [1, 1, 1];

/** The light to draw; `null` where what it needs has not come yet. The `fields` are light groups: they add up. */
export function illuminate(
  source: LightSource,
  live: Float32Array | null,
  fields: readonly Field[],
  { place, probe, gradients, before }: Circumstances,
): Lighting | null {
  if (source === "stream") {
    if (live === null) return null;
    const distant = withBands(live, PAGE_BANDS);
    return { illumination: { distant, fields: [], gradients, surround: distant }, modulation: null };
  }
  if (fields.length === 0) return null;
  const at = (point: Vector3) => fields.map((field) => withBands(field.sample(point, gradients), PAGE_BANDS));
  const modulation = source === "both" && live !== null ? modulate(withBands(live, PAGE_BANDS), at(probe), before) : null;
  const gains = modulation?.gains ?? fields.map(() => UNIT);
  const distant = modulation?.rest ?? null;
  const surround = Float32Array.from(distant ?? new Float32Array(3 * PAGE_BANDS * PAGE_BANDS));
  at(place).forEach((here, k) => here.forEach((value, i) => (surround[i]! += gains[k]![i % 3]! * value)));
  const lit = fields.map((field, k) => ({ field, gain: gains[k]! }));
  return { illumination: { distant, fields: lit, gradients, surround }, modulation };
}

/** The middle of a grid. */
export function middleOf({ lower, upper }: { lower: Vector3; upper: Vector3 }): Vector3 {
  return lower.map((low, k) => (low + upper[k]!) / 2) as unknown as Vector3;
}
