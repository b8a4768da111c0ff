// What a grid is: a box of cells, and the light at the centre of each.

import type { Vector3 } from "../sh.ts";

/** A grid as the server describes it (`GET /api/v1/grids/{id}`), world axes and metres. */
export interface GridInfo {
  id: string;
  lower: Vector3;
  upper: Vector3;
  /** Cells along x, y and z. */
  resolution: Vector3;
  bands: number;
  units: string;
  /** What has to be multiplied to the texels of `gpu_tiles`. */
  scale: number;
  /** Bytes that its tiles take on the GPU. */
  bytes: number;
}

/** How far the grid that was asked for has come. */
export interface GridState {
  /** Share of the tiles that have arrived, 0 … 1; 1 also where there is no grid to load. */
  loading: number;
  /** The grid that is shown, or is being loaded. */
  info: GridInfo | null;
  /** Why it cannot be shown, in words; empty where nothing is wrong. */
  problem: string;
}

export const NO_GRID: GridState = { loading: 1, info: null, problem: "" };
