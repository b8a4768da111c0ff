// Light that one or more live probes with known places give to an object beside them.

import type { Lighting } from "../grid/illuminate.ts";
import type { Light } from "../live.ts";
import { PAGE_BANDS, withBands, type Vector3 } from "../sh.ts";
import type { WebGLRenderer } from "three";
import { LocalField } from "./local.ts";
import { Places, SampleSet } from "./samples.ts";

/** A live probe, and where it stands in world metres. */
export interface Probe {
  name: string;
  position: Vector3;
  light: Light;
}

/** Where an object is. */
export interface Spot {
  middle: Vector3;
  radius: number;
}

export class NearLight {
  private readonly local = new LocalField();
  private places: Places | null = null;

  /** Send everything to the GPU, which has lost its memory. */
  restore(renderer: WebGLRenderer): void {
    this.local.field.atlas.send(renderer);
  }

  /**
   * The light to draw at a spot. What the light in the object's middle is comes from afar, to every pixel; how it departs
   * from that over the object is looked up, at vertices or pixels. `gradients`: use those that probes have.
   */
  illuminate(probes: readonly Probe[], { middle, radius }: Spot, gradients: boolean, renderer: WebGLRenderer | null): Lighting {
    const set = this.setOf(probes, gradients);
    const distant = Float32Array.from(set.at(middle));
    const illumination = { distant, fields: [], gradients: false, surround: distant };
    // One probe without a gradient lights all alike.
    if (probes.length === 1 && !set.gradients) return { illumination, modulation: null };
    this.local.fill(set, middle, radius, distant, renderer);
    const fields = [{ field: this.local.field, gain: [1, 1, 1] as Vector3 }];
    return { illumination: { ...illumination, fields }, modulation: null };
  }

  private setOf(probes: readonly Probe[], gradients: boolean): SampleSet {
    // Those bands that all have: a probe without the others does not say that they are dark there.
    const bands = Math.min(...probes.map(({ light }) => Math.sqrt(light.coefficients.length / 3)));
    const samples = probes.map(({ position, light }) => ({
      position,
      coefficients: withBands(light.coefficients.subarray(0, 3 * bands * bands), PAGE_BANDS),
      gradients: gradients && light.gradients !== null ? padded(light.gradients.subarray(0, 9 * bands * bands)) : null,
    }));
    const positions = samples.map(({ position }) => position);
    if (JSON.stringify(positions) !== JSON.stringify(this.places?.positions)) this.places = new Places(positions);
    return new SampleSet(samples, this.places!);
  }
}

/** With as many bands as the page draws, zeros where there are fewer. */
function padded(gradients: Float32Array): Float32Array {
  const result = new Float32Array(9 * PAGE_BANDS * PAGE_BANDS);
  result.set(gradients.subarray(0, result.length));
  return result;
}
