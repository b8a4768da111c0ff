// A grid's light in memory: read tile by tile, looked up at points here and by shaders.

import { Data3DTexture, DataUtils, HalfFloatType, LinearFilter, RGBAFormat, type IUniform, type Vector2, type Vector3 as ThreeVector, type WebGLRenderer } from "three";

import { PAGE_BANDS, type Vector3 } from "../sh.ts";
import type { GridInfo } from "./info.ts";
import { atlasLayout, tileCount, type AtlasLayout } from "./layout.ts";
import { TileArray, below, readAttributes } from "./zarr.ts";

const REGULAR = "lightwell.grid.v1";
const BYTES_OF_TEXEL = 8;
/** More than that makes browsers lose their graphics. */
const MOST_BYTES = 1024 ** 3;
/** Tiles that are on their way at once. */
const AT_ONCE = 4;

/** What the GPU takes. */
export interface Limits {
  /** Texels along an axis of a 3D texture. */
  largest: number;
  bytes: number;
}

export function limitsOf(renderer: WebGLRenderer): Limits {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  return { largest: gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number, bytes: MOST_BYTES };
}

export class Field {
  readonly texture: Data3DTexture;
  private uploaded = false;

  constructor(
    readonly info: GridInfo,
    /** Bands of the tiles that are kept, at most as many as the page draws. */
    readonly stored: number,
    readonly layout: AtlasLayout,
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

  /** Send the tiles to the GPU; raises `Error` where its memory does not suffice. */
  upload(renderer: WebGLRenderer): void {
    if (this.uploaded) return;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    while (gl.getError() !== gl.NO_ERROR);
    renderer.initTexture(this.texture);
    const { __webglTexture: texture } = renderer.properties.get(this.texture) as { __webglTexture: WebGLTexture };
    const [x, y, z] = this.info.resolution;
    // Three has just set flipping and alignment as this texture wants them.
    renderer.state.bindTexture(gl.TEXTURE_3D, texture);
    this.tiles.forEach((tile, i) => {
      const column = i % this.layout.columns;
      const row = Math.floor(i / this.layout.columns);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, column * x, row * y, 0, x, y, z, gl.RGBA, gl.HALF_FLOAT, tile);
    });
    renderer.state.unbindTexture();
    if (gl.getError() !== gl.NO_ERROR) throw new Error(tooLarge(this.info, "the graphics memory does not suffice"));
    this.uploaded = true;
  }

  /** The GPU has lost its memory: the next upload sends everything again. */
  forgetUpload(): void {
    this.uploaded = false;
  }

  dispose(): void {
    this.texture.dispose();
  }

  /** Fill the uniforms of `shader.ts`. */
  describe(uniforms: Record<string, IUniform>, gain: Vector3): void {
    const { lower, upper, resolution, scale } = this.info;
    const [width, height, depth] = this.layout.size;
    const vector = (name: string) => uniforms[name]!.value as ThreeVector;
    uniforms["field"]!.value = this.texture;
    vector("fieldLower").set(...lower);
    vector("fieldPerMetre").set(
      resolution[0] / (upper[0] - lower[0]),
      resolution[1] / (upper[1] - lower[1]),
      resolution[2] / (upper[2] - lower[2]),
    );
    vector("fieldCells").set(...resolution);
    vector("fieldTexel").set(1 / width, 1 / height, 1 / depth);
    (uniforms["fieldStep"]!.value as Vector2).set(resolution[0] / width, resolution[1] / height);
    vector("fieldGain").set(scale * gain[0], scale * gain[1], scale * gain[2]);
  }

  /** Coefficients at a point, `(stored², 3)`: trilinear between cell centres, constant beyond the outermost. */
  sample(point: Vector3): Float32Array {
    const { lower, upper, resolution, scale } = this.info;
    const count = this.stored * this.stored;
    const groups = count >> 2;
    const result = new Float32Array(3 * count);
    const low = [0, 0, 0];
    const fraction = [0, 0, 0];
    for (let axis = 0; axis < 3; axis++) {
      const cells = resolution[axis]!;
      const place = ((point[axis]! - lower[axis]!) / (upper[axis]! - lower[axis]!)) * cells - 0.5;
      const inside = Math.min(Math.max(place, 0), cells - 1);
      low[axis] = Math.min(Math.floor(inside), Math.max(cells - 2, 0));
      fraction[axis] = inside - low[axis]!;
    }
    for (let corner = 0; corner < 8; corner++) {
      let weight = scale;
      const at = [0, 0, 0];
      for (let axis = 0; axis < 3; axis++) {
        const far = (corner >> axis) & 1;
        weight *= far === 1 ? fraction[axis]! : 1 - fraction[axis]!;
        at[axis] = low[axis]! + far;
      }
      if (weight === 0) continue;
      const texel = 4 * ((at[2]! * resolution[1] + at[1]!) * resolution[0] + at[0]!);
      for (let i = 0; i < count; i++) {
        for (let channel = 0; channel < 3; channel++) {
          const lone = i >> 2 === groups;
          const tile = this.tiles[lone ? 3 * groups : 3 * (i >> 2) + channel]!;
          const bits = tile[texel + (lone ? channel : i & 3)]!;
          result[3 * i + channel]! += weight * DataUtils.fromHalfFloat(bits);
        }
      }
    }
    return result;
  }
}

function tooLarge({ resolution, bytes }: GridInfo, reason: string): string {
  const size = resolution.join(" × ");
  return `The grid of ${size} cells (${(bytes / 2 ** 20).toFixed(0)} MiB) is too large to draw: ${reason}. Make one with fewer cells.`;
}

/** What a grid's attributes say; raises `Error` where the page cannot draw it, with the reason in words. */
export function describeGrid(id: string, attributes: Record<string, unknown>): GridInfo {
  if (attributes["format"] !== REGULAR) {
    const adaptive = String(attributes["format"]).includes("adaptive");
    throw new Error(
      adaptive
        ? "This grid is adaptive, which the page does not draw. Open the regular grid of the same job."
        : `This is no regular grid (${REGULAR}).`,
    );
  }
  const triple = (name: string): Vector3 => {
    const value = attributes[name];
    if (!Array.isArray(value) || value.length !== 3 || !value.every(Number.isFinite)) {
      throw new Error(`The grid's attribute ${name} is missing or damaged; make it anew.`);
    }
    return value as unknown as Vector3;
  };
  const resolution = triple("resolution");
  const bands = Number(attributes["bands"]);
  const tiles = tileCount(Math.min(bands, PAGE_BANDS));
  return {
    id,
    lower: triple("lower_m"),
    upper: triple("upper_m"),
    resolution,
    bands,
    units: String(attributes["units"] ?? "relative"),
    scale: Number(attributes["gpu_tiles_scale"] ?? 1),
    bytes: tiles * resolution[0] * resolution[1] * resolution[2] * BYTES_OF_TEXEL,
  };
}

/** Arrange the grid's tiles; raises `Error` where the GPU does not take so many. */
export function arrange(info: GridInfo, limits: Limits): AtlasLayout {
  const layout = atlasLayout(info.resolution, tileCount(Math.min(info.bands, PAGE_BANDS)), limits.largest);
  if (layout === null) throw new Error(tooLarge(info, `textures here have at most ${limits.largest} texels along an axis`));
  if (info.bytes > limits.bytes) throw new Error(tooLarge(info, `the page takes ${limits.bytes / 2 ** 20} MiB`));
  return layout;
}

export interface Progress {
  (share: number, info: GridInfo): void;
}

/** Read a grid below the address of its Zarr folder. Raises `Error` with the reason in words. */
export async function loadField(folder: URL, id: string, limits: Limits, signal: AbortSignal, progress: Progress): Promise<Field> {
  const info = describeGrid(id, await readAttributes(folder, signal));
  const layout = arrange(info, limits);
  progress(0, info);
  const array = await TileArray.open(below(folder, "gpu_tiles"), signal);
  const [tiles, z, y, x] = array.shape;
  if (tiles !== tileCount(info.bands) || [x, y, z].some((size, axis) => size !== info.resolution[axis])) {
    throw new Error("The grid's tiles do not fit its resolution and bands; make it anew.");
  }
  const stored = Math.min(info.bands, PAGE_BANDS);
  const more = info.bands > PAGE_BANDS;
  // Of a grid with more bands, the next three tiles hold the last coefficient that the page draws.
  const wanted = more ? tileCount(stored) + 2 : tileCount(stored);
  const read: Uint16Array[] = [];
  let next = 0;
  let done = 0;
  const reader = async () => {
    while (next < wanted) {
      const index = next++;
      read[index] = await array.tile(index, signal);
      progress(++done / wanted, info);
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, reader));
  if (more) read.push(firstLanes(read.splice(-3) as [Uint16Array, Uint16Array, Uint16Array]));
  return new Field(info, stored, layout, read);
}

/** One tile with red, green and blue of the coefficient in the first lanes of three. */
function firstLanes([red, green, blue]: [Uint16Array, Uint16Array, Uint16Array]): Uint16Array {
  const tile = new Uint16Array(red.length);
  for (let i = 0; i < tile.length; i += 4) {
    tile[i] = red[i]!;
    tile[i + 1] = green[i]!;
    tile[i + 2] = blue[i]!;
  }
  return tile;
}
