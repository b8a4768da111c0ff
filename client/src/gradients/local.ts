// Light that differs over one object: how it departs, at the nodes of a small lattice about the object, from the light in
// the object's middle. Shaders look it up as they look up grids, at each vertex or fragment, whatever the samples are;
// what is linear in space, as one sample's extrapolation is, comes out exactly.

import { DataUtils, type WebGLRenderer } from "three";

import { Atlas } from "../grid/atlas.ts";
import { Field } from "../grid/field.ts";
import type { GridInfo } from "../grid/info.ts";
import { RegularLattice } from "../grid/lattice.ts";
import { atlasLayout, tileCount } from "../grid/layout.ts";
import { PAGE_BANDS, type Vector3 } from "../sh.ts";
import type { Mix, Places, SampleSet } from "./samples.ts";

/** Nodes along each edge. */
export const NODES = 7;
const COUNT = PAGE_BANDS * PAGE_BANDS;
const GROUPS = COUNT >> 2;

export class LocalField {
  readonly field: Field;
  private readonly info: GridInfo = {
    id: "",
    lower: [0, 0, 0],
    upper: [1, 1, 1],
    resolution: [NODES, NODES, NODES],
    bands: PAGE_BANDS,
    units: "",
    slots: null,
    scale: 1,
    bendScale: null,
    bytes: 8 * NODES ** 3 * tileCount(PAGE_BANDS),
  };
  private readonly tiles = Array.from({ length: tileCount(PAGE_BANDS) }, () => new Uint16Array(4 * NODES ** 3));
  private readonly departures = new Float32Array(3 * COUNT * NODES ** 3);
  private mixes: Mix[] = [];
  private mixedFor = "";
  private places: Places | null = null;

  constructor() {
    const lattice = new RegularLattice(this.info);
    const layout = atlasLayout(this.info.resolution, this.tiles.length, 512)!;
    this.field = new Field(this.info, PAGE_BANDS, lattice, new Atlas(layout, lattice.tile, this.tiles), null);
  }

  /**
   * Take over the light of samples of `PAGE_BANDS` bands, less `base`, within `radius` metres about `middle` along each
   * axis. `renderer`: send it to the GPU.
   */
  fill(samples: SampleSet, middle: Vector3, radius: number, base: Float32Array, renderer: WebGLRenderer | null): void {
    this.mixFor(samples.places, middle, radius);
    let largest = 0;
    const values = new Float64Array(3 * COUNT);
    this.mixes.forEach((mix, node) => {
      samples.mixed(mix, values);
      for (let i = 0; i < values.length; i++) {
        const departure = values[i]! - base[i]!;
        this.departures[values.length * node + i] = departure;
        largest = Math.max(largest, Math.abs(departure));
      }
    });
    // Halves are exact to a part in 2000 over a wide range; what is to come is kept away from its ends.
    this.info.scale = largest > 0 ? largest : 1;
    for (let i = 0; i < COUNT; i++) {
      const lone = i >> 2 === GROUPS;
      for (let channel = 0; channel < 3; channel++) {
        const tile = this.tiles[lone ? 3 * GROUPS : 3 * (i >> 2) + channel]!;
        const lane = lone ? channel : i & 3;
        for (let node = 0; node < NODES ** 3; node++) {
          const value = this.departures[3 * (COUNT * node + i) + channel]! / this.info.scale;
          tile[4 * node + lane] = DataUtils.toHalfFloat(value);
        }
      }
    }
    if (renderer !== null) this.field.atlas.send(renderer);
  }

  private mixFor(places: Places, middle: Vector3, radius: number): void {
    const key = JSON.stringify([middle, radius]);
    if (key === this.mixedFor && places === this.places) return;
    [this.mixedFor, this.places] = [key, places];
    const step = (2 * radius) / (NODES - 1);
    this.info.lower = middle.map((value) => value - radius - step / 2) as unknown as Vector3;
    this.info.upper = middle.map((value) => value + radius + step / 2) as unknown as Vector3;
    this.mixes = Array.from({ length: NODES ** 3 }, (_, node) => {
      const steps = [node % NODES, Math.floor(node / NODES) % NODES, Math.floor(node / NODES ** 2)];
      return places.mix(steps.map((k, axis) => middle[axis]! - radius + k * step) as unknown as Vector3);
    });
  }
}
