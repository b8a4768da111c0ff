// What a grid is: a box of cells, and the light at the centre of each.

import type { Vector3 } from "../sh.ts";

/** Grids that are light groups together, at most: each takes two of 16 texture units. */
export const MOST_GROUPS = 4;

/** A grid as its attributes describe it, world axes and metres. */
export interface GridInfo {
  id: string;
  lower: Vector3;
  upper: Vector3;
  /** Cells along x, y and z; of an adaptive grid those of the regular grid that it stands for. */
  resolution: Vector3;
  bands: number;
  units: string;
  /** Of an adaptive grid: bricks along x, y and z of its tiles. */
  slots: Vector3 | null;
  /** What has to be multiplied to the texels of its tiles. */
  scale: number;
  /** The same of its bends, by which gradients are drawn; `null`: the grid has none. */
  bendScale: number | null;
  /** Bytes that its tiles take on the GPU, without bends. */
  bytes: number;
}

/** How far the grids that were asked for have come. */
export interface GridState {
  /** Share of the tiles that have arrived, 0 … 1; 1 also where there is no grid to load. */
  loading: number;
  /** The grid that is shown, or is being loaded; of light groups, the first. */
  info: GridInfo | null;
  /** Whether gradients are there that can be drawn. */
  gradients: boolean;
  /** Why it cannot be shown, or not all of it, in words; empty where nothing is wrong. */
  problem: string;
}

export const NO_GRID: GridState = { loading: 1, info: null, gradients: false, problem: "" };
