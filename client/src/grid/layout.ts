// How a grid's tiles lie in one 3D texture: a texture a tile would take more units than many machines have.

import type { Vector3 } from "../sh.ts";

/** Tiles of `bands²` coefficients, as lightwell.field.tiles packs them: 1, 3, 7, 12, 19, 27. */
export function tileCount(bands: number): number {
  const coefficients = bands * bands;
  return Math.floor(coefficients / 4) * 3 + (coefficients % 4);
}

export interface AtlasLayout {
  columns: number;
  rows: number;
  /** Texels along x, y and z. */
  size: Vector3;
}

/**
 * Lay `tiles` tiles of the grid's size beside and above each other; as few texels as possible are wasted, and the texture
 * is as square as can be. `null` where no arrangement keeps within `largest` texels along each axis.
 */
export function atlasLayout(resolution: Vector3, tiles: number, largest: number): AtlasLayout | null {
  const [x, y, z] = resolution;
  if (z > largest) return null;
  let best: AtlasLayout | null = null;
  for (let columns = 1; columns <= tiles; columns++) {
    const rows = Math.ceil(tiles / columns);
    const size: Vector3 = [columns * x, rows * y, z];
    if (size[0] > largest || size[1] > largest) continue;
    const waste = columns * rows - tiles;
    const bestWaste = best === null ? Infinity : best.columns * best.rows - tiles;
    const squarer = best === null || Math.max(...size) < Math.max(...best.size);
    if (waste < bestWaste - 1 || (waste <= bestWaste + 1 && squarer)) best = { columns, rows, size };
  }
  return best;
}
