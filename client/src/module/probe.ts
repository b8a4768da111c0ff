import { LightProbe, type Mesh } from "three";

import { LiveStream, type ConnectionState } from "../live.ts";
import { DARKNESS, LightUniforms } from "../materials.ts";
import { PAGE_BANDS, withBands } from "../sh.ts";
import { toSphericalHarmonics3 } from "./axes.ts";
import { Surfaces, type SurfaceOptions } from "./surface.ts";

/** Options of {@link LightwellProbe}. */
export interface ProbeOptions {
  /** Token, where the server wants one. */
  token?: string;
  /** Whether +Y is up in the page, as three.js has it; true by default. False: +Z is. */
  yUp?: boolean;
  /** Exponent of the Phong lobe of all glossy surfaces; 12 by default. */
  exponent?: number;
}

/**
 * The live light of a Lightwell stream in a three.js page.
 *
 * @example
 * ```js
 * const probe = new LightwellProbe("http://127.0.0.1:8400", "room");
 * scene.add(probe.light);                        // three's own materials: nine coefficients
 * probe.illuminate(mesh, { color: "#d8d2c8", gloss: 0.3 }); // 25 coefficients, gloss, baked shadows
 * renderer.setAnimationLoop(() => {
 *   probe.update();                              // takes the newest light, if there is any
 *   renderer.render(scene, camera);
 * });
 * ```
 */
export class LightwellProbe {
  /** Lights whatever has one of three's own materials (`MeshStandardMaterial` …). Add it to the scene. */
  readonly light = new LightProbe();
  private readonly stream: LiveStream;
  private readonly uniforms = new LightUniforms();
  private readonly surfaces: Surfaces;
  private readonly yUp: boolean;
  private readonly exponent: number;
  private shown: unknown = null;

  /**
   * Connects at once, and again whenever the connection is lost.
   *
   * @param server - Address of the Lightwell server, such as `http://127.0.0.1:8400`.
   * @param stream - Name of the stream.
   */
  constructor(server: string, stream: string, options: ProbeOptions = {}) {
    const base = new URL(server.replace(/\/?$/, "/"));
    if (options.token !== undefined) base.searchParams.set("token", options.token);
    this.yUp = options.yUp ?? true;
    this.exponent = options.exponent ?? 12;
    this.surfaces = new Surfaces(this.uniforms, this.yUp ? "three" : "lightwell");
    this.stream = new LiveStream(base.href);
    this.stream.setBackdrop(false);
    this.stream.follow(stream);
  }

  /** Take over the newest light. Call it before each picture; says whether there was new light. */
  update(): boolean {
    const newest = this.stream.light;
    if (newest === null || newest === this.shown) return false;
    this.shown = newest;
    const distant = withBands(newest.coefficients, PAGE_BANDS);
    this.uniforms.set({ distant, fields: [], gradients: false, surround: DARKNESS }, PAGE_BANDS, this.exponent);
    toSphericalHarmonics3(distant, this.yUp, this.light.sh);
    this.surfaces.refresh();
    return true;
  }

  /** Coefficients of the newest light as the server sends them: `(25, 3)`, +Z up; `null` before there is any. */
  get coefficients(): Float32Array | null {
    return this.stream.light?.coefficients ?? null;
  }

  /** Whether light comes, and if not, why. */
  get state(): { connection: ConnectionState; problem: string } {
    return { connection: this.stream.state(performance.timeOrigin + performance.now()), problem: this.stream.problem };
  }

  /** Give a mesh a material that this light falls on. Transfer in attributes `_PRT0` … makes it shade itself. */
  illuminate(mesh: Mesh, options: SurfaceOptions = {}): void {
    this.surfaces.illuminate(mesh, options);
  }

  /** Close the connection and give the materials back. */
  dispose(): void {
    this.stream.close();
    this.surfaces.dispose();
  }
}
