// The picture: camera, controls and the loop that draws when something has changed.

import {
  ArrowHelper,
  Color,
  NeutralToneMapping,
  PerspectiveCamera,
  Raycaster,
  Scene,
  Spherical,
  Vector2,
  Vector3,
  WebGLRenderer,
  type Mesh,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { Surroundings } from "./backdrop.ts";
import { nowMs } from "./clock.ts";
import { NO_GRID, type GridInfo, type GridState } from "./grid/info.ts";
import type { Modulation } from "./grid/modulate.ts";
import type { Light, LiveStream } from "./live.ts";
import { LightUniforms, litMaterial } from "./materials.ts";
import { Rate } from "./rate.ts";
import { meanLuminance } from "./sh.ts";
import { BOUNDS, loadStillLife } from "./stilllife.ts";
import { EV_RANGE, change, view, type View } from "./view.ts";

const FIELD_OF_VIEW_DEGREES = 36;
const HOME_DIRECTION = new Vector3(0.3, -1, 0.3).normalize();
/** Without a graphics card the cost of a picture is its pixels. */
const SOFTWARE_PIXEL_RATIO = 0.75;
const ARROW_LENGTH = 0.65;
const BALL = { colour: "#ffffff", gloss: 0.92 };
const TABLE = { colour: "#77736d", gloss: 0 };
/** Mean radiance of the light, exposed, that looks right on the objects and behind them. */
const METERED_LEVEL = 0.3;
const ADAPTATION_MS = 700;

/** Pixels of the window that the panel covers, on the right and at the bottom. */
export interface Covered {
  right: number;
  bottom: number;
}

export class Viewport {
  readonly drawn = new Rate();
  readonly rendererName: string;
  readonly isSoftware: boolean;
  /** Exposure that fits the light of the last seconds, EV: as eyes do, it adapts slowly, so that changes are seen. */
  meteredEv = 0;
  private meteredMs = 0;
  paused = false;
  /** The light on the objects: the newest, unless paused or held. */
  shown: Light | null = null;
  /** How far the grid that was asked for has come. */
  gridState: GridState = NO_GRID;
  /** How the live light changes the grid's; `null` where only one of them is shown. */
  modulation: Modulation | null = null;

  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.05, 200);
  private readonly controls: OrbitControls;
  private readonly light = new LightUniforms();
  private readonly materials = {
    bunny: litMaterial(this.light, "#ffffff", 0),
    ball: litMaterial(this.light, BALL.colour, BALL.gloss),
    table: litMaterial(this.light, TABLE.colour, TABLE.gloss),
  };
  private readonly surroundings: Surroundings;
  private readonly arrow = new ArrowHelper(new Vector3(0, 0, -1), new Vector3(), ARROW_LENGTH, 0xffffff, 0.22, 0.12);
  private objects: Mesh[] = [];
  private covered: Covered = { right: 0, bottom: 0 };
  private dirty = true;
  private fence: WebGLSync | null = null;
  private dragging = false;
  /** The user has dragged, and the motion has not come to rest. */
  private moved = false;
  private appliedCamera: View["camera"] = null;
  /** Light of the past that is shown instead of the newest. */
  private held: Light | null = null;

  /** Raises `Error` where the browser has no WebGL 2. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly live: LiveStream,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "high-performance" });
    this.renderer.toneMapping = NeutralToneMapping;
    const gl = this.renderer.getContext();
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.rendererName = String(gl.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
    this.isSoftware = /swiftshader|llvmpipe|software/i.test(this.rendererName);

    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.minDistance = 0.8;
    this.controls.maxDistance = 40;
    this.controls.addEventListener("start", () => (this.dragging = true));
    this.controls.addEventListener("end", () => {
      this.dragging = false;
      this.moved = true;
    });

    this.controls.addEventListener("change", () => this.surroundings.invalidate());

    this.surroundings = new Surroundings(this.camera, this.light);
    this.scene.add(this.surroundings.mesh, this.arrow);
    canvas.addEventListener("dblclick", (event) => this.focus(event));
    new ResizeObserver(() => this.resize()).observe(canvas);
    view.subscribe((value) => this.applyView(value));
    this.resize();
  }

  /** Fetch the objects and start to draw. */
  async start(): Promise<void> {
    this.renderer.setAnimationLoop(() => this.update());
    const { meshes, transferScale } = await loadStillLife(new URL("scene.bin", document.baseURI).href, this.materials);
    for (const material of Object.values(this.materials)) material.uniforms["transferScale"]!.value = transferScale;
    this.objects = meshes;
    this.scene.add(...meshes);
    this.dirty = true;
  }

  /** Forget another stream's light. */
  clear(): void {
    this.shown = null;
    this.held = null;
    this.surroundings.clear();
    this.dirty = true;
  }

  /** Hold this light, one of the last seconds; `null`: follow the newest again. */
  setTime(light: Light | null): void {
    this.held = light;
  }

  /** Load a grid and light the objects with it; `null` takes it away. Raises `Error` with the reason in words. */
  showGrid(id: string): Promise<GridInfo>;
  showGrid(id: null): Promise<null>;
  showGrid(id: string | null): Promise<GridInfo | null>;
  showGrid(id: string | null): Promise<GridInfo | null> {
    return id === null ? Promise.resolve(null) : Promise.reject(new Error("not yet"));
  }

  /** Show the meshes of a finished transfer job. Raises `Error` with the reason in words. */
  showTransfer(_jobId: string): Promise<void> {
    return Promise.reject(new Error("not yet"));
  }

  cover(covered: Covered): void {
    this.covered = covered;
    this.resize();
  }

  /** Go back to the framed start. */
  reset(): void {
    this.moved = false;
    change({ camera: null });
  }

  /** Frame the objects from where the camera is. */
  frame(): void {
    const direction = this.camera.position.clone().sub(this.controls.target).normalize();
    this.place(BOUNDS.center, direction);
    this.rememberCamera();
  }

  /** Turn around the target, radians. */
  orbit(azimuth: number, elevation: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    // Spherical takes +Y as its pole: turn our +Z there and back.
    const spherical = new Spherical().setFromVector3(new Vector3(offset.x, offset.z, -offset.y));
    spherical.theta += azimuth;
    spherical.phi -= elevation;
    const turned = new Vector3().setFromSpherical(spherical.makeSafe());
    this.camera.position.copy(this.controls.target).add(new Vector3(turned.x, -turned.z, turned.y));
    this.rememberCamera();
  }

  zoom(factor: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const distance = Math.min(this.controls.maxDistance, Math.max(this.controls.minDistance, offset.length() * factor));
    this.camera.position.copy(this.controls.target).add(offset.setLength(distance));
    this.rememberCamera();
  }

  /** The picture as it is, without the panel. */
  screenshot(): Promise<Blob> {
    // Drawn in the same task: the browser clears the buffer after it.
    this.render();
    return new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob === null ? reject(new Error("The picture could not be encoded.")) : resolve(blob)));
    });
  }

  private update(): void {
    const newest = this.held ?? this.live.light;
    if ((!this.paused || this.held !== null) && newest !== this.shown) {
      if (newest !== null) this.meter(newest);
      this.shown = newest;
      this.applyLight(view.peek());
    }
    if (this.live.backdrop !== null && !this.paused) {
      this.surroundings.offer(this.live.backdrop);
      this.live.backdrop = null;
    }
    if (this.surroundings.update()) this.dirty = true;
    if (this.controls.update()) {
      this.dirty = true;
    } else if (this.moved && !this.dragging) {
      this.moved = false;
      this.rememberCamera();
    }
    if (this.dirty && !this.isDrawing()) this.render();
  }

  /** Whether the last picture is still being drawn: pictures that queue up would delay everything else on the page. */
  private isDrawing(): boolean {
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    if (this.fence === null) return false;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return true;
    gl.deleteSync(this.fence);
    this.fence = null;
    return false;
  }

  private render(): void {
    this.dirty = false;
    this.surroundings.prepare(this.renderer);
    this.renderer.render(this.scene, this.camera);
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    if (this.fence !== null) gl.deleteSync(this.fence);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.drawn.add(nowMs());
  }

  private meter(light: Light): void {
    const level = meanLuminance(light.coefficients);
    const wanted = level > 0 ? Math.log2(METERED_LEVEL / level) : 0;
    const timeMs = nowMs();
    const share = this.shown === null ? 1 : 1 - Math.exp(-(timeMs - this.meteredMs) / ADAPTATION_MS);
    const adapted = this.meteredEv + share * (wanted - this.meteredEv);
    this.meteredEv = Math.min(EV_RANGE.max, Math.max(EV_RANGE.min, adapted));
    this.meteredMs = timeMs;
    this.expose(view.peek());
  }

  private expose({ ev }: View): void {
    this.renderer.toneMappingExposure = 2 ** (ev ?? this.meteredEv);
  }

  private applyView(value: View): void {
    this.expose(value);
    const { bunny } = this.materials;
    (bunny.uniforms["albedo"]!.value as Color).set(value.colour);
    bunny.uniforms["gloss"]!.value = value.gloss;
    this.surroundings.mesh.visible = value.backdrop !== "off";
    this.surroundings.preferPicture(value.backdrop === "picture");
    this.live.setBackdrop(value.backdrop === "picture");
    if (value.camera !== this.appliedCamera) this.applyCamera(value.camera);
    this.applyLight(value);
  }

  private applyCamera(camera: View["camera"]): void {
    this.appliedCamera = camera;
    if (camera === null) {
      this.placeAtHome();
    } else {
      const [px, py, pz, tx, ty, tz] = camera as [number, number, number, number, number, number];
      this.camera.position.set(px, py, pz);
      this.controls.target.set(tx, ty, tz);
      this.controls.update();
    }
  }

  private applyLight(value: View): void {
    if (this.shown !== null) this.light.set(this.shown.coefficients, value.bands, value.exponent);
    for (const material of Object.values(this.materials)) this.light.apply(material, value.shadows);
    if (this.surroundings.followsLight) this.surroundings.invalidate();
    const dominant = this.shown?.frame.dominant ?? null;
    this.arrow.visible = value.arrow && dominant !== null;
    if (dominant !== null) {
      const direction = new Vector3(...dominant.direction);
      this.arrow.position.copy(BOUNDS.center).addScaledVector(direction, 0.95 + ARROW_LENGTH);
      this.arrow.setDirection(direction.negate());
      this.arrow.setColor(hue(dominant.irradiance));
    }
    this.dirty = true;
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    const { right, bottom } = this.covered;
    this.renderer.setPixelRatio(this.isSoftware ? SOFTWARE_PIXEL_RATIO : Math.min(devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    // The middle of the picture is the middle of what the panel leaves free.
    this.camera.setViewOffset(clientWidth, clientHeight, right / 2, bottom / 2, clientWidth, clientHeight);
    if (view.peek().camera === null) this.placeAtHome();
    this.surroundings.invalidate();
    this.dirty = true;
  }

  private placeAtHome(): void {
    this.place(BOUNDS.center, HOME_DIRECTION);
  }

  /** Look at `target` from `direction`, so far away that the objects fit into the free part of the picture. */
  private place(target: Vector3, direction: Vector3): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const halfHeight = Math.tan((FIELD_OF_VIEW_DEGREES * Math.PI) / 360);
    const free = Math.min(width - this.covered.right, (height - this.covered.bottom) * 1.25);
    const halfFree = (halfHeight * free) / height;
    const distance = BOUNDS.radius / Math.sin(Math.atan(halfFree));
    // Without damping an update uses up what is left of an earlier motion.
    this.controls.enableDamping = false;
    this.controls.update();
    this.controls.enableDamping = true;
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(direction, distance);
    this.controls.update();
    this.dirty = true;
  }

  private focus(event: MouseEvent): void {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const pointer = new Vector2(
      (2 * (event.clientX - left)) / width - 1,
      1 - (2 * (event.clientY - top)) / height,
    );
    const raycaster = new Raycaster();
    raycaster.setFromCamera(pointer, this.camera);
    const hit = raycaster.intersectObjects(this.objects, false)[0];
    if (hit === undefined) return;
    const shift = hit.point.clone().sub(this.controls.target);
    this.controls.target.add(shift);
    this.camera.position.add(shift);
    this.rememberCamera();
  }

  private rememberCamera(): void {
    this.controls.update();
    this.dirty = true;
    this.appliedCamera = [...this.camera.position.toArray(), ...this.controls.target.toArray()];
    change({ camera: this.appliedCamera });
  }
}

/** The colour of a light, at full brightness. */
function hue(rgb: readonly [number, number, number]): Color {
  const largest = Math.max(...rgb, 1e-6);
  return new Color(...(rgb.map((value) => Math.max(0, value) / largest) as [number, number, number]));
}
