// Where a place lies among the texels of a grid's tiles: on one lattice, or in the brick of an adaptive grid that covers it.

import { Data3DTexture, NearestFilter, RGBAIntegerFormat, UnsignedByteType } from "three";

import type { Vector3 } from "../sh.ts";
import { STEPS } from "./bricks.ts";
import type { GridInfo } from "./info.ts";

/** A brick's slot is kept in bytes. */
const MOST_SLOTS = 256;

/** A place between eight texels of a tile. */
export interface Place {
  /** The lowest of them, x, y and z. */
  low: Vector3;
  /** How far it is from that, 0 … 1 along each axis. */
  fraction: Vector3;
}

export interface Lattice {
  /** Texels of a tile along x, y and z. */
  readonly tile: Vector3;
  locate(point: Vector3): Place;
}

const each = (of: (axis: number) => number): Vector3 => [of(0), of(1), of(2)];

/** Steps from the centre of the first cell, within those of the outermost. */
function stepsTo({ lower, upper, resolution }: GridInfo, point: Vector3): Vector3 {
  return each((axis) => {
    const cells = resolution[axis]!;
    const place = ((point[axis]! - lower[axis]!) / (upper[axis]! - lower[axis]!)) * cells - 0.5;
    return Math.min(Math.max(place, 0), cells - 1);
  });
}

function between(places: Vector3, counts: Vector3): Place {
  const low = each((axis) => Math.min(Math.floor(places[axis]!), Math.max(counts[axis]! - 2, 0)));
  return { low, fraction: each((axis) => places[axis]! - low[axis]!) };
}

/** A texel a cell. */
export class RegularLattice implements Lattice {
  constructor(private readonly info: GridInfo) {}

  get tile(): Vector3 {
    return this.info.resolution;
  }

  locate(point: Vector3): Place {
    return between(stepsTo(this.info, point), this.info.resolution);
  }
}

/** Bricks of an octree side by side, each with its border; a table says which one covers a block of `STEPS` steps. */
export class BrickLattice implements Lattice {
  readonly tile: Vector3;
  /** Blocks along x, y and z. */
  readonly blocks: Vector3;
  /** The level from which on one brick covers an axis. */
  readonly depths: Vector3;
  /** Nodes of a brick along x, y and z. */
  readonly nodes: Vector3;
  /** The slot of the brick that covers a block, and how coarse it is: four bytes a block. */
  readonly pages: Data3DTexture;
  private readonly table: Uint8Array;

  /**
   * `pages`: the brick that covers each block, x fastest; `levels`: how coarse each brick is. Raises `Error` where they do
   * not fit the grid.
   */
  constructor(
    private readonly info: GridInfo,
    pages: Int32Array,
    levels: Uint8Array,
  ) {
    const { resolution } = info;
    const slots = info.slots!;
    this.blocks = each((axis) => Math.max(1, Math.ceil((resolution[axis]! - 1) / STEPS)));
    this.depths = each((axis) => Math.ceil(Math.log2(this.blocks[axis]!)));
    this.nodes = each((axis) => (resolution[axis]! > 1 ? STEPS + 1 : 1));
    this.tile = each((axis) => slots[axis]! * this.nodes[axis]!);
    const [x, y, z] = this.blocks;
    const room = Math.min(levels.length, slots[0] * slots[1] * slots[2]);
    if (pages.length !== x * y * z || pages.some((brick) => brick < 0 || brick >= room) || Math.max(...slots) > MOST_SLOTS) {
      throw new Error("The adaptive grid's tables do not fit each other; make it anew.");
    }
    this.table = new Uint8Array(4 * pages.length);
    pages.forEach((brick, i) => {
      const [across, up] = slots;
      this.table.set([brick % across, Math.floor(brick / across) % up, Math.floor(brick / (across * up)), levels[brick]!], 4 * i);
    });
    this.pages = new Data3DTexture(this.table, x, y, z);
    this.pages.format = RGBAIntegerFormat;
    this.pages.type = UnsignedByteType;
    this.pages.internalFormat = "RGBA8UI";
    this.pages.minFilter = this.pages.magFilter = NearestFilter;
    this.pages.needsUpdate = true;
  }

  locate(point: Vector3): Place {
    const steps = stepsTo(this.info, point);
    const block = each((axis) => Math.min(Math.floor(steps[axis]! / STEPS), this.blocks[axis]! - 1));
    const entry = 4 * ((block[2] * this.blocks[1] + block[1]) * this.blocks[0] + block[0]);
    const level = this.table[entry + 3]!;
    const local = each((axis) => {
      const span = 2 ** Math.min(level, this.depths[axis]!);
      return steps[axis]! / span - Math.floor(block[axis]! / span) * STEPS;
    });
    const { low, fraction } = between(local, this.nodes);
    return { low: each((axis) => this.table[entry + axis]! * this.nodes[axis]! + low[axis]!), fraction };
  }
}
