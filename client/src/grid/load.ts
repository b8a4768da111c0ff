// Reading grids below the address of their Zarr folder, tile by tile.

import type { WebGLRenderer } from "three";

import { PAGE_BANDS, type Vector3 } from "../sh.ts";
import { Atlas } from "./atlas.ts";
import { STEPS } from "./bricks.ts";
import { Field } from "./field.ts";
import type { GridInfo } from "./info.ts";
import { BrickLattice, RegularLattice, type Lattice } from "./lattice.ts";
import { atlasLayout, tileCount, type AtlasLayout } from "./layout.ts";
import { TileArray, below, readAttributes, readWhole } from "./zarr.ts";

const REGULAR = "lightwell.grid.v1";
const ADAPTIVE = "lightwell.adaptive-grid.v1";
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

export function tooLarge({ resolution, bytes }: GridInfo, reason: string): string {
  const size = resolution.join(" × ");
  return `The grid of ${size} cells (${(bytes / 2 ** 20).toFixed(0)} MiB) is too large to draw: ${reason}. Make one with fewer cells.`;
}

/** What a grid's attributes say; raises `Error` where the page cannot draw it, with the reason in words. */
export function describeGrid(id: string, attributes: Record<string, unknown>): GridInfo {
  const form = attributes["format"];
  if (form !== REGULAR && form !== ADAPTIVE) throw new Error(`This is no grid (${REGULAR} or ${ADAPTIVE}).`);
  const triple = (name: string): Vector3 => {
    const value = attributes[name];
    if (!Array.isArray(value) || value.length !== 3 || !value.every(Number.isFinite)) {
      throw new Error(`The grid's attribute ${name} is missing or damaged; make it anew.`);
    }
    return value as unknown as Vector3;
  };
  const adaptive = form === ADAPTIVE;
  const resolution = triple("resolution");
  const bands = Number(attributes["bands"]);
  const bendScale = attributes["gpu_bends_scale"];
  const slots = adaptive ? triple("gpu_slots") : null;
  const info: GridInfo = {
    id,
    lower: triple("lower_m"),
    upper: triple("upper_m"),
    resolution,
    bands,
    units: String(attributes["units"] ?? "relative"),
    slots,
    scale: Number(attributes[adaptive ? "gpu_bricks_scale" : "gpu_tiles_scale"] ?? 1),
    bendScale: adaptive || bendScale === undefined ? null : Number(bendScale),
    bytes: 0,
  };
  const texels = tileOf(info).reduce((product, size) => product * size, 1);
  return { ...info, bytes: tileCount(Math.min(bands, PAGE_BANDS)) * texels * BYTES_OF_TEXEL };
}

/** Texels of a tile along x, y and z. */
function tileOf({ resolution, slots }: GridInfo): Vector3 {
  if (slots === null) return resolution;
  return slots.map((count, k) => count * (resolution[k]! > 1 ? STEPS + 1 : 1)) as unknown as Vector3;
}

/** Arrange the grid's tiles; raises `Error` where the GPU does not take so many. */
export function arrange(info: GridInfo, limits: Limits): AtlasLayout {
  const layout = atlasLayout(tileOf(info), tileCount(Math.min(info.bands, PAGE_BANDS)), limits.largest);
  if (layout === null) throw new Error(tooLarge(info, `textures here have at most ${limits.largest} texels along an axis`));
  if (info.bytes > limits.bytes) throw new Error(tooLarge(info, `the page has ${(limits.bytes / 2 ** 20).toFixed(0)} MiB for it`));
  return layout;
}

/** Arrange the bends of the grid's gradients; `null` where there are none, or the GPU does not take them too. */
export function arrangeBends(info: GridInfo, limits: Limits): AtlasLayout | null {
  if (info.bendScale === null || 4 * info.bytes > limits.bytes) return null;
  return atlasLayout(tileOf(info), 3 * tileCount(Math.min(info.bands, PAGE_BANDS)), limits.largest);
}

export interface Progress {
  (share: number, info: GridInfo): void;
}

/** Read a grid below the address of its Zarr folder. Raises `Error` with the reason in words. */
export async function loadField(folder: URL, id: string, limits: Limits, signal: AbortSignal, progress: Progress): Promise<Field> {
  const info = describeGrid(id, await readAttributes(folder, signal));
  const layout = arrange(info, limits);
  const bendLayout = arrangeBends(info, limits);
  progress(0, info);
  const stored = Math.min(info.bands, PAGE_BANDS);
  const lattice = await readLattice(folder, info, signal);
  const reader = new TileReader(info, signal, bendLayout === null ? 1 : 4, progress);
  const array = info.slots === null ? "gpu_tiles" : "gpu_bricks";
  const [tiles] = await reader.read(below(folder, array), lattice.tile, 1);
  const atlas = new Atlas(layout, lattice.tile, tiles!);
  if (bendLayout === null) return new Field(info, stored, lattice, atlas, null);
  const bends = await reader.read(below(folder, "gpu_bends"), lattice.tile, 3);
  return new Field(info, stored, lattice, atlas, new Atlas(bendLayout, lattice.tile, bends.flat()));
}

async function readLattice(folder: URL, info: GridInfo, signal: AbortSignal): Promise<Lattice> {
  if (info.slots === null) return new RegularLattice(info);
  const [pages, levels] = await Promise.all(["pages", "levels"].map((name) => readWhole(below(folder, name), signal)));
  return new BrickLattice(info, Int32Array.from(pages!), Uint8Array.from(levels!));
}

class TileReader {
  private done = 0;

  constructor(
    private readonly info: GridInfo,
    private readonly signal: AbortSignal,
    /** Sets of tiles that will be read in all. */
    private readonly sets: number,
    private readonly progress: Progress,
  ) {}

  /** Read `sets` sets of tiles, each of all coefficients that the page draws. */
  async read(folder: URL, tile: Vector3, sets: number): Promise<Uint16Array[][]> {
    const { info, signal } = this;
    const array = await TileArray.open(folder, signal);
    const [count, z, y, x] = array.shape;
    const each = tileCount(info.bands);
    if (count !== sets * each || [x, y, z].some((size, axis) => size !== tile[axis])) {
      throw new Error("The grid's tiles do not fit its resolution and bands; make it anew.");
    }
    const stored = tileCount(Math.min(info.bands, PAGE_BANDS));
    const more = info.bands > PAGE_BANDS;
    // Of a grid with more bands, the next three tiles hold the last coefficient that the page draws.
    const wanted = more ? stored + 2 : stored;
    const read: Uint16Array[][] = Array.from({ length: sets }, () => []);
    let next = 0;
    const reader = async () => {
      while (next < sets * wanted) {
        const [set, index] = [Math.floor(next / wanted), next % wanted];
        next++;
        read[set]![index] = await array.tile(set * each + index, signal);
        this.progress(++this.done / (this.sets * wanted), info);
      }
    };
    await Promise.all(Array.from({ length: AT_ONCE }, reader));
    if (more) for (const set of read) set.push(firstLanes(set.splice(-3) as [Uint16Array, Uint16Array, Uint16Array]));
    return read;
  }
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
