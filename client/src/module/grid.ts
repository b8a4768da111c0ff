import { Box3, SphericalHarmonics3, type Mesh, type Vector3, type WebGLRenderer } from "three";

import type { Field } from "../grid/field.ts";
import { limitsOf, loadField, tooLarge } from "../grid/load.ts";
import { DARKNESS, LightUniforms } from "../materials.ts";
import { PAGE_BANDS } from "../sh.ts";
import { toLightwell, toSphericalHarmonics3, toThree } from "./axes.ts";
import { Surfaces, type SurfaceOptions } from "./surface.ts";

/** Options of {@link LightwellGrid.load}. */
export interface GridOptions {
  /** Token, where the server wants one. */
  token?: string;
  /** Whether +Y is up in the page, as three.js has it; true by default. False: +Z is. */
  yUp?: boolean;
  /** Exponent of the Phong lobe of all glossy surfaces; 12 by default. */
  exponent?: number;
  /** Where the field is looked up: `vertex` (default) is fast and asks for fine meshes, `fragment` is exact. */
  sampling?: "vertex" | "fragment";
  /** Whether the grid's gradients are used, where it has any; true by default. They quadruple the cost of a look-up. */
  gradients?: boolean;
  /** Is told the share that has arrived, 0 … 1. */
  onProgress?: (share: number) => void;
  signal?: AbortSignal;
}

/**
 * A finished light-field grid in a three.js page: meshes get the light of the place where they are. One unit of the page
 * is one metre.
 *
 * @example
 * ```js
 * const grid = await LightwellGrid.load("http://127.0.0.1:8400/api/v1/artifacts/JOB.grid", renderer);
 * grid.illuminate(mesh, { color: "#d8d2c8" });
 * grid.box.getCenter(mesh.position); // move it: the light follows
 * ```
 */
export class LightwellGrid {
  /** What the grid covers, in the axes of the page. Beyond it the light is that of the nearest place inside. */
  readonly box: Box3;
  private readonly uniforms = new LightUniforms();
  private readonly surfaces: Surfaces;

  private constructor(
    private readonly field: Field,
    private readonly yUp: boolean,
    private readonly exponent: number,
    private readonly gradients: boolean,
    sampling: "vertex" | "fragment",
  ) {
    const { lower, upper } = field.info;
    this.box = new Box3().setFromPoints([lower, upper].map((corner) => this.fromLightwell(corner)));
    this.uniforms.sampling = sampling;
    this.surfaces = new Surfaces(this.uniforms, yUp ? "three" : "lightwell");
    this.setGain(1, 1, 1);
  }

  /**
   * Read a grid and send it to the GPU.
   *
   * @param url - Address of its Zarr folder: `…/api/v1/artifacts/JOB.grid`, or wherever a copy of the folder lies.
   * @throws Error where it cannot be had or drawn, with the reason in words.
   */
  static async load(url: string, renderer: WebGLRenderer, options: GridOptions = {}): Promise<LightwellGrid> {
    const folder = new URL(url, document.baseURI);
    if (options.token !== undefined) folder.searchParams.set("token", options.token);
    const signal = options.signal ?? new AbortController().signal;
    const id = folder.pathname.split("/").filter(Boolean).at(-1) ?? "grid";
    const field = await loadField(folder, id, limitsOf(renderer), signal, (share) => options.onProgress?.(share));
    if (!field.upload(renderer)) {
      field.dispose();
      throw new Error(tooLarge(field.info, "the graphics memory does not suffice"));
    }
    const { yUp = true, exponent = 12, gradients = true, sampling = "vertex" } = options;
    return new LightwellGrid(field, yUp, exponent, gradients, sampling);
  }

  /** Multiply the light: exposure, or a lamp that is dimmed. */
  setGain(red: number, green: number, blue: number): void {
    const fields = [{ field: this.field, gain: [red, green, blue] as const }];
    const { gradients } = this;
    this.uniforms.set({ distant: null, fields, gradients, surround: DARKNESS }, PAGE_BANDS, this.exponent);
    this.surfaces.refresh();
  }

  /** The light at a place of the page, as three's `LightProbe` takes it (`probe.sh`): for meshes with other materials. */
  sample(place: Vector3, target = new SphericalHarmonics3()): SphericalHarmonics3 {
    const point = this.yUp ? toLightwell(place) : place.toArray();
    return toSphericalHarmonics3(this.field.sample(point, this.gradients), this.yUp, target);
  }

  /** Give a mesh a material that takes the light of each of its places. */
  illuminate(mesh: Mesh, options: SurfaceOptions = {}): void {
    this.surfaces.illuminate(mesh, options);
  }

  /** Give the GPU's memory and the materials back. */
  dispose(): void {
    this.surfaces.dispose();
    this.field.dispose();
  }

  private fromLightwell(point: readonly [number, number, number]): Vector3 {
    return this.yUp ? toThree(point) : toThree([point[0], -point[2], point[1]]);
  }
}
