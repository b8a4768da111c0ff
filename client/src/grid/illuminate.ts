// Which light is drawn: the stream's, the grid's, or the grid's as the stream changes it.

import type { Illumination } from "../materials.ts";
import { PAGE_BANDS, withBands, type Vector3 } from "../sh.ts";
import type { LightSource } from "../view.ts";
import type { Field } from "./field.ts";
import { modulate, type Modulation } from "./modulate.ts";

export interface Lighting {
  illumination: Illumination;
  modulation: Modulation | null;
}

const UNIT: Vector3 = [1, 1, 1];

/**
 * The light to draw; `null` where what it needs has not come yet. `place` is where the object is: what surrounds it there
 * stands behind the picture and is what the exposure is metered on.
 */
export function illuminate(source: LightSource, live: Float32Array | null, field: Field | null, place: Vector3): Lighting | null {
  if (source === "stream") {
    if (live === null) return null;
    const distant = withBands(live, PAGE_BANDS);
    return { illumination: { distant, field: null, gain: UNIT, surround: distant }, modulation: null };
  }
  if (field === null) return null;
  const here = withBands(field.sample(place), PAGE_BANDS);
  if (source === "grid" || live === null) {
    return { illumination: { distant: null, field, gain: UNIT, surround: here }, modulation: null };
  }
  const modulation = modulate(withBands(live, PAGE_BANDS), withBands(field.sample(probePlace(field)), PAGE_BANDS));
  const { gain, rest, method } = modulation;
  const surround = here.map((value, i) => gain[i % 3]! * value + rest[i]!);
  const distant = method === "gain" ? null : rest;
  return { illumination: { distant, field, gain, surround }, modulation };
}

/** Where the live probe stands in the grid: in its middle, as nothing says otherwise. */
function probePlace({ info: { lower, upper } }: Field): Vector3 {
  return [(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, (lower[2] + upper[2]) / 2];
}

