// Tiles of one size in one 3D texture of halves.

import { Data3DTexture, DataUtils, HalfFloatType, LinearFilter, RGBAFormat, type WebGLRenderer } from "three";

import type { Vector3 } from "../sh.ts";
import type { AtlasLayout } from "./layout.ts";

export class Atlas {
  readonly texture: Data3DTexture;
  private uploaded = false;

  constructor(
    readonly layout: AtlasLayout,
    /** Texels of a tile along x, y and z. */
    private readonly tile: Vector3,
    private readonly tiles: readonly Uint16Array[],
  ) {
    this.texture = new Data3DTexture(null, ...layout.size);
    this.texture.format = RGBAFormat;
    this.texture.type = HalfFloatType;
    this.texture.minFilter = this.texture.magFilter = LinearFilter;
    this.texture.unpackAlignment = 1;
    // Three would send a texture without data and complain; the tiles are sent one by one instead.
    this.texture.source.dataReady = false;
    this.texture.needsUpdate = true;
  }

  /** Send the tiles to the GPU once; says whether its memory suffices. */
  upload(renderer: WebGLRenderer): boolean {
    if (this.uploaded) return true;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    while (gl.getError() !== gl.NO_ERROR);
    this.send(renderer);
    this.uploaded = gl.getError() === gl.NO_ERROR;
    return this.uploaded;
  }

  /** Send the tiles as they are now; whether that worked is not asked, for the answer would have to be waited for. */
  send(renderer: WebGLRenderer): void {
    const gl = renderer.getContext() as WebGL2RenderingContext;
    renderer.initTexture(this.texture);
    const { __webglTexture: texture } = renderer.properties.get(this.texture) as { __webglTexture: WebGLTexture };
    const [x, y, z] = this.tile;
    renderer.state.bindTexture(gl.TEXTURE_3D, texture);
    // Three keeps these as its last texture wanted them.
    const { state } = renderer;
    state.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    state.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    state.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.tiles.forEach((tile, i) => {
      const column = i % this.layout.columns;
      const row = Math.floor(i / this.layout.columns);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, column * x, row * y, 0, x, y, z, gl.RGBA, gl.HALF_FLOAT, tile);
    });
    renderer.state.unbindTexture();
  }

  /** The GPU has lost its memory: the next upload sends everything again. */
  forgetUpload(): void {
    this.uploaded = false;
  }

  dispose(): void {
    this.texture.dispose();
  }

  /** Number of a texel in each tile. */
  texel(x: number, y: number, z: number): number {
    return (z * this.tile[1] + y) * this.tile[0] + x;
  }

  /**
   * Add `count` RGB coefficients at a texel to `sum`, weighted. Their tiles begin at `first`, four coefficients a texel:
   * lightwell.field.tiles.
   */
  add(sum: Float32Array, count: number, first: number, texel: number, weight: number): void {
    const groups = count >> 2;
    for (let i = 0; i < count; i++) {
      const lone = i >> 2 === groups;
      for (let channel = 0; channel < 3; channel++) {
        const tile = this.tiles[first + (lone ? 3 * groups : 3 * (i >> 2) + channel)]!;
        sum[3 * i + channel]! += weight * DataUtils.fromHalfFloat(tile[4 * texel + (lone ? channel : i & 3)]!);
      }
    }
  }
}
