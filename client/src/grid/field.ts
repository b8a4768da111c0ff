// A grid's light in memory: looked up at points here and by shaders.

import { Vector2, Vector3 as ThreeVector, type Data3DTexture, type IUniform, type WebGLRenderer } from "three";

import type { Vector3 } from "../sh.ts";
import type { MemberVariant } from "../shader.ts";
import type { Atlas } from "./atlas.ts";
import type { GridInfo } from "./info.ts";
import { BrickLattice, type Lattice } from "./lattice.ts";
import { tileCount } from "./layout.ts";

/** The uniforms of one field, by their names in `shader.ts` after `field` and its number. */
export function fieldUniforms(): Record<string, IUniform> {
  return {
    "": { value: null as Data3DTexture | null },
    Lower: { value: new ThreeVector() },
    PerMetre: { value: new ThreeVector(1, 1, 1) },
    Cells: { value: new ThreeVector(1, 1, 1) },
    Texel: { value: new ThreeVector(1, 1, 1) },
    Step: { value: new Vector2() },
    Gain: { value: new ThreeVector(1, 1, 1) },
    Bends: { value: null as Data3DTexture | null },
    BendTexel: { value: new ThreeVector(1, 1, 1) },
    BendStep: { value: new Vector2() },
    BendScale: { value: 1 },
    Pages: { value: null as Data3DTexture | null },
    LastBlock: { value: new ThreeVector() },
    Depths: { value: new ThreeVector() },
    Nodes: { value: new ThreeVector(1, 1, 1) },
  };
}

export class Field {
  constructor(
    readonly info: GridInfo,
    /** Bands of the tiles that are kept, at most as many as the page draws. */
    readonly stored: number,
    readonly lattice: Lattice,
    readonly atlas: Atlas,
    /** What gradients add to the trilinear filter (lightwell.field.tiles), for x, y and z; `null`: nothing. */
    readonly bends: Atlas | null,
  ) {}

  /** Send everything to the GPU; says whether its memory suffices. */
  upload(renderer: WebGLRenderer): boolean {
    return this.atlas.upload(renderer) && (this.bends?.upload(renderer) ?? true);
  }

  /** The GPU has lost its memory: the next upload sends everything again. */
  forgetUpload(): void {
    this.atlas.forgetUpload();
    this.bends?.forgetUpload();
  }

  dispose(): void {
    this.atlas.dispose();
    this.bends?.dispose();
    if (this.lattice instanceof BrickLattice) this.lattice.pages.dispose();
  }

  /** What a shader has to know of it. */
  variant(gradients: boolean): MemberVariant {
    return {
      form: this.lattice instanceof BrickLattice ? "bricks" : "cells",
      stored: this.stored,
      columns: this.atlas.layout.columns,
      bendColumns: gradients && this.bends !== null ? this.bends.layout.columns : null,
    };
  }

  /** Fill the uniforms of `shader.ts`. */
  describe(uniforms: Record<string, IUniform>, gain: Vector3): void {
    const { lower, upper, resolution, scale, bendScale } = this.info;
    const { atlas, bends, lattice } = this;
    const vector = (name: string) => uniforms[name]!.value as ThreeVector;
    const steps = (name: string, { layout }: Atlas) => {
      const [width, height, depth] = layout.size;
      vector(`${name}Texel`).set(1 / width, 1 / height, 1 / depth);
      (uniforms[`${name}Step`]!.value as Vector2).set(lattice.tile[0] / width, lattice.tile[1] / height);
    };
    uniforms[""]!.value = atlas.texture;
    vector("Lower").set(...lower);
    vector("PerMetre").set(...(upper.map((high, k) => resolution[k]! / (high - lower[k]!)) as [number, number, number]));
    vector("Cells").set(...resolution);
    steps("", atlas);
    vector("Gain").set(scale * gain[0], scale * gain[1], scale * gain[2]);
    if (bends !== null) {
      uniforms["Bends"]!.value = bends.texture;
      steps("Bend", bends);
      uniforms["BendScale"]!.value = bendScale! / scale;
    }
    if (lattice instanceof BrickLattice) {
      uniforms["Pages"]!.value = lattice.pages;
      vector("LastBlock").set(...lattice.blocks).subScalar(1);
      vector("Depths").set(...lattice.depths);
      vector("Nodes").set(...lattice.nodes);
    }
  }

  /**
   * Coefficients at a point, `(stored², 3)`: trilinear between cell centres, with gradients by the half-gradient rule;
   * constant beyond the outermost.
   */
  sample(point: Vector3, gradients = true): Float32Array {
    const { scale, bendScale } = this.info;
    const count = this.stored * this.stored;
    const sum = new Float32Array(3 * count);
    const { low, fraction } = this.lattice.locate(point);
    /** Add an atlas, filtered along all axes but one, where it is the lower texel's. */
    const add = (atlas: Atlas, first: number, factor: number, still: number | null) => {
      for (let corner = 0; corner < 8; corner++) {
        if (still !== null && ((corner >> still) & 1) === 1) continue;
        let weight = factor;
        const at: [number, number, number] = [...low];
        for (let axis = 0; axis < 3; axis++) {
          if (axis === still) continue;
          const far = (corner >> axis) & 1;
          weight *= far === 1 ? fraction[axis]! : 1 - fraction[axis]!;
          at[axis]! += far;
        }
        if (weight !== 0) atlas.add(sum, count, first, atlas.texel(...at), weight);
      }
    };
    add(this.atlas, 0, scale, null);
    if (gradients && this.bends !== null) {
      fraction.forEach((f, axis) => add(this.bends!, axis * tileCount(this.stored), bendScale! * f * (1 - f), axis));
    }
    return sum;
  }
}
