// The picture: camera, controls and the loop that draws when something has changed.

import {
  ArrowHelper,
  Color,
  NeutralToneMapping,
  PerspectiveCamera,
  Raycaster,
  Scene,
  Sphere,
  Spherical,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { apiUrl } from "./api.ts";
import { Surroundings } from "./backdrop.ts";
import { nowMs } from "./clock.ts";
import { NearLight, type Probe } from "./gradients/near.ts";
import { Probes } from "./gradients/probes.ts";
import type { Field } from "./grid/field.ts";
import { Gizmo } from "./grid/gizmo.ts";
import { illuminate, middleOf, type Lighting } from "./grid/illuminate.ts";
import { NO_GRID, type GridInfo, type GridState } from "./grid/info.ts";
import { limitsOf, loadField, tooLarge } from "./grid/load.ts";
import type { Modulation } from "./grid/modulate.ts";
import { Volume } from "./grid/volume.ts";
import { looksTheSame, type Light, type LiveStream } from "./live.ts";
import { lookTheSame, type LiveField } from "./livefield.ts";
import { DARK, LightUniforms } from "./materials.ts";
import { loadOwnObject } from "./objects/own.ts";
import type { Subject } from "./objects/subject.ts";
import { loadTransfer } from "./objects/transfer.ts";
import { Rate } from "./rate.ts";
import { meanLuminance, withBands, type Vector3 as Triple } from "./sh.ts";
import { BOUNDS } from "./stilllife.ts";
import { EV_RANGE, OWN_OBJECTS, change, isOfGrid, isOfStream, view, type View } from "./view.ts";
import type { Backdrop } from "./wire.ts";

const FIELD_OF_VIEW_DEGREES = 36;
const HOME_DIRECTION = new Vector3(0.3, -1, 0.3).normalize();
/** Without a graphics card the cost of a picture is its pixels. */
const SOFTWARE_PIXEL_RATIO = 0.75;
const ARROW_LENGTH = 0.65;
/** Beside probes the arrow is as large against the object as beside the still life. */
const ARROW_OBJECT = 1.82;
/** Of what is beside probes, how much wider than the object the camera frames, for what the trust radius is. */
const FRAMED_TRUST = 2.5;
/** Radius of the object in a grid, of the box's shortest edge (of the longest at least half of that). */
const SIZE_IN_GRID = 0.26;
/** Mean radiance of the light, exposed, that looks right on the objects and behind them. */
const METERED_LEVEL = 0.3;
const ADAPTATION_MS = 700;
/** Differences of exposure that nobody sees, EV. */
const ADAPTED_EV = 0.005;

/** Pixels of the window that the panel covers, on the right and at the bottom. */
export interface Covered {
  right: number;
  bottom: number;
}

/** The object beside live probes, as it is shown. */
export interface Near {
  probes: readonly Probe[];
  place: Triple;
  /** Radius of the object, metres. */
  radius: number;
  /** Why the light of these probes cannot be combined, in words; empty where it can. */
  problem: string;
}

/** From where the picture is seen, world metres. */
export interface ShownCamera {
  position: Triple;
  target: Triple;
  /** From the lower to the upper edge. */
  fovDegrees: number;
}

/** What there is about the object: a grid, probes, or nothing but light from afar. */
type Setting = "grid" | "probes" | "afar";

export class Viewport {
  readonly drawn = new Rate();
  readonly rendererName: string;
  readonly isSoftware: boolean;
  /** Exposure that fits the light of the last seconds, EV: as eyes do, it adapts slowly, so that changes are seen. */
  meteredEv = 0;
  private meteredMs = 0;
  paused = false;
  /** Where the stream's settings say that its probe stands, world metres; `null`: they do not. */
  private probeStands: Triple | null = null;
  /** The light on the objects: the newest, unless paused or held. */
  shown: Light | null = null;
  /** The object beside the probes that light it; `null` where light comes from afar or from a grid. */
  near: Near | null = null;
  /** How far the grid that was asked for has come. */
  gridState: GridState = NO_GRID;
  /** How the live light changes the grid's; `null` where only one of them is shown. */
  modulation: Modulation | null = null;

  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.05, 200);
  private readonly controls: OrbitControls;
  private readonly light = new LightUniforms();
  private readonly surroundings: Surroundings;
  private readonly volume = new Volume(this.light);
  private readonly gizmo: Gizmo;
  private readonly probeGizmo: Gizmo;
  private readonly nearLight = new NearLight();
  private readonly probes = new Probes();
  /** The newest light of each stream of the field, unless paused. */
  private fieldLights: ReadonlyMap<string, Light> = new Map();
  /** The grids that are shown together: light groups, the first of which says where the box is. */
  private fields: readonly Field[] = [];
  private wantedGrids: readonly string[] = [];
  private subject: Subject | null = null;
  /** The object that is shown or on its way: a name of the page's own, or a job. */
  private wantedObject = "";
  private fetchingGrid = new AbortController();
  private fetchingObject = new AbortController();
  /** The light as it is drawn. */
  private lighting: Lighting = { illumination: DARK, modulation: null };
  /** Mean radiance that the exposure is metered on; `null` before there is any light. */
  private level: number | null = null;
  private adapted = false;
  private readonly arrow = new ArrowHelper(new Vector3(0, 0, -1), new Vector3(), ARROW_LENGTH, 0xffffff, 0.22, 0.12);
  private covered: Covered = { right: 0, bottom: 0 };
  private dirty = true;
  private fence: WebGLSync | null = null;
  private dragging = false;
  /** The first object, which the start waits for. */
  private firstObject: Promise<void> = Promise.resolve();
  /** The drag that is on its way, or was last, is one of the object's handles. */
  private handled = false;
  /** The user has dragged, and the motion has not come to rest. */
  private moved = false;
  private appliedCamera: View["camera"] = null;
  /** What the home that was applied last is of. */
  private setting: Setting = "afar";
  /** Light of the past that is shown instead of the newest. */
  private held: Light | null = null;

  /** Raises `Error` where the browser has no WebGL 2. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly live: LiveStream,
    private readonly liveField: LiveField,
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
    this.controls.addEventListener("start", () => {
      this.dragging = true;
      this.handled = false;
    });
    this.controls.addEventListener("end", () => {
      this.dragging = false;
      // Whoever has dragged the object has not turned the camera.
      this.moved = !this.handled;
    });

    this.controls.addEventListener("change", () => this.surroundings.invalidate());

    this.surroundings = new Surroundings(this.camera, this.light);
    const handles = (move: (place: Triple) => void) =>
      new Gizmo(this.camera, canvas, {
        drag: (active) => {
          this.controls.enabled = !active;
          if (active) this.handled = true;
        },
        move,
        changed: () => (this.dirty = true),
      });
    this.gizmo = handles((place) => this.moveTo(place));
    this.probeGizmo = handles((place) => change({ probeAt: place }));
    const { group } = this.volume;
    this.scene.add(this.surroundings.mesh, this.arrow, group, this.probes.group, this.gizmo.group, this.probeGizmo.group);
    canvas.addEventListener("webglcontextrestored", () => {
      // A fence of the lost context would never be signalled.
      this.fence = null;
      for (const field of this.fields) {
        field.forgetUpload();
        field.upload(this.renderer);
      }
      this.nearLight.restore(this.renderer);
      this.surroundings.invalidate();
      this.dirty = true;
    });
    canvas.addEventListener("dblclick", (event) => this.focus(event));
    new ResizeObserver(() => this.resize()).observe(canvas);
    view.subscribe((value) => this.applyView(value));
    this.resize();
  }

  get shownCamera(): ShownCamera {
    return { position: this.camera.position.toArray(), target: this.controls.target.toArray(), fovDegrees: this.camera.fov };
  }

  /** Fetch the objects and start to draw. */
  async start(): Promise<void> {
    this.renderer.setAnimationLoop(() => this.update());
    await this.firstObject;
  }

  /** Forget another stream's light. */
  clear(): void {
    this.shown = null;
    this.held = null;
    this.surroundings.clear();
    this.dirty = true;
  }

  /** Say where the stream's settings have its probe, world metres; `null`: nowhere. */
  standProbe(place: Triple | null): void {
    if (String(place) === String(this.probeStands)) return;
    this.probeStands = place;
    this.applyLight(view.peek());
  }

  /** Hold this light, one of the last seconds, and the picture of its time; `null`: follow the newest again. */
  setTime(light: Light | null, picture: Backdrop | null = null): void {
    this.held = light;
    if (picture !== null) this.surroundings.offer(picture);
  }

  /**
   * Load grids, to light the objects with: one, or light groups that add up; none takes them away. Those that are there
   * already stay. Raises `Error` with the reason in words.
   */
  async showGrids(ids: readonly string[]): Promise<void> {
    this.fetchingGrid.abort();
    const { signal } = (this.fetchingGrid = new AbortController());
    this.wantedGrids = ids;
    const known = new Map(this.fields.map((field) => [field.info.id, field]));
    const loaded: Field[] = [];
    const fresh: Field[] = [];
    this.gridState = ids.length === 0 ? NO_GRID : { ...NO_GRID, loading: 0, info: known.get(ids[0]!)?.info ?? null };
    try {
      for (const [k, id] of ids.entries()) {
        const field = known.get(id) ?? (await this.load(id, k, loaded, signal));
        if (!known.has(id)) fresh.push(field);
        signal.throwIfAborted();
        loaded.push(field);
      }
      const [info, gradients] = [loaded[0]?.info ?? null, loaded.some(({ bends }) => bends !== null)];
      this.gridState = { loading: 1, info, gradients, problem: "" };
      this.takeFields(loaded);
    } catch (error) {
      if (signal.aborted) {
        for (const field of fresh) field.dispose();
      } else {
        // What has come is shown: of light groups, those before the one that cannot be had.
        this.gridState = { ...this.gridState, loading: 1, problem: (error as Error).message };
        this.takeFields(loaded);
      }
      throw error;
    }
  }

  private async load(id: string, k: number, before: readonly Field[], signal: AbortSignal): Promise<Field> {
    const folder = apiUrl(document.baseURI, `artifacts/${encodeURIComponent(id)}`);
    const limits = limitsOf(this.renderer);
    const taken = before.reduce((sum, { info, bends }) => sum + info.bytes * (bends === null ? 1 : 4), 0);
    const field = await loadField(folder, id, { ...limits, bytes: limits.bytes - taken }, signal, (share, info) => {
      const loading = (k + share) / this.wantedGrids.length;
      if (!signal.aborted) this.gridState = { ...this.gridState, loading, info: before[0]?.info ?? info };
    });
    if (!signal.aborted && field.upload(this.renderer)) return field;
    field.dispose();
    signal.throwIfAborted();
    throw new Error(tooLarge(field.info, "the graphics memory does not suffice"));
  }

  /** Show the meshes of a finished transfer job. Raises `Error` with the reason in words. */
  showTransfer(jobId: string): Promise<void> {
    return this.show(jobId, (signal) => loadTransfer(jobId, this.light, signal));
  }

  /** Radius of the object with what it stands on, metres; 0 before there is one. */
  get objectRadius(): number {
    return this.subject?.bounds.radius ?? 0;
  }

  /** Move the object, or the live probe, by shares of the grid's edges, or of the object's size beside probes. */
  nudge(x: number, y: number, z: number, what: "object" | "probe" = "object"): void {
    const edges = this.edges();
    const value = view.peek();
    if (edges === null || (what === "probe" && this.probeIsKnown)) return;
    const place = what === "object" ? this.place3(value) : this.probePlace(value);
    const moved = [x, y, z].map((share, k) => place[k]! + share * edges[k]!) as unknown as Triple;
    if (what === "object") this.moveTo(moved);
    else change({ probeAt: moved });
  }

  /** What a nudge is a share of; `null` where nothing can be moved. */
  private edges(): Triple | null {
    if (this.near !== null) return [4 * this.near.radius, 4 * this.near.radius, 4 * this.near.radius];
    const info = this.fields[0]?.info;
    return info === undefined || !isOfGrid(view.peek().light) ? null : (info.upper.map((high, k) => high - info.lower[k]!) as unknown as Triple);
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
    const { center, radius } = this.framed();
    this.place(center, direction, radius);
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
      const before = this.shown;
      this.shown = newest;
      // What does not depend on the stream does not change with it, and a stream may show the same light: nothing to draw.
      const changes = before === null || newest === null || !looksTheSame(newest, before);
      if (changes && isOfStream(view.peek().light)) this.applyLight(view.peek());
    }
    if (!this.paused && this.liveField.lights !== this.fieldLights) {
      const before = this.fieldLights;
      this.fieldLights = this.liveField.lights;
      if (view.peek().light === "field" && !lookTheSame(this.fieldLights, before)) this.applyLight(view.peek());
    }
    this.adapt();
    if (this.live.backdrop !== null && !this.paused) {
      this.surroundings.offer(this.live.backdrop);
      this.live.backdrop = null;
    }
    if (this.surroundings.update()) this.dirty = true;
    // A mirror reflects the picture as soon as there is one.
    if (this.light.behind !== this.surroundings.source) this.applyLight(view.peek());
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

  /** Let the exposure follow the light, a little with each picture. */
  private adapt(): void {
    const timeMs = nowMs();
    const elapsedMs = timeMs - this.meteredMs;
    this.meteredMs = timeMs;
    if (this.level === null) return;
    const wanted = this.level > 0 ? Math.log2(METERED_LEVEL / this.level) : 0;
    const bounded = Math.min(EV_RANGE.max, Math.max(EV_RANGE.min, wanted));
    if (Math.abs(bounded - this.meteredEv) < ADAPTED_EV) return;
    // The first light is seen at once.
    const share = this.adapted ? 1 - Math.exp(-elapsedMs / ADAPTATION_MS) : 1;
    this.adapted = true;
    this.meteredEv += share * (bounded - this.meteredEv);
    if (view.peek().ev !== null) return;
    this.expose(view.peek());
    this.dirty = true;
  }

  private expose({ ev }: View): void {
    this.renderer.toneMappingExposure = 2 ** (ev ?? this.meteredEv);
  }

  private applyView(value: View): void {
    this.expose(value);
    this.surroundings.mesh.visible = value.backdrop !== "off";
    // A grid's light is that of another place than the picture's; a mirror wants the picture even where it is not seen.
    const wantsPicture = isOfStream(value.light) && (value.backdrop === "picture" || (value.backdrop === "off" && value.mirror > 0));
    this.surroundings.preferPicture(wantsPicture);
    this.live.setBackdrop(wantsPicture);
    if ((OWN_OBJECTS as readonly string[]).includes(value.object) && value.object !== this.wantedObject) {
      const name = value.object as (typeof OWN_OBJECTS)[number];
      this.firstObject = this.show(name, () => loadOwnObject(name, this.light));
      // `start` waits for the first; of later ones the file is there already.
      this.firstObject.catch(() => undefined);
    }
    this.applyLight(value);
    if (value.camera !== this.appliedCamera) this.applyCamera(value.camera);
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
    const fields = isOfGrid(value.light) ? this.fields : [];
    const place = this.place3(value);
    const lighting = this.lightingOf(value, fields, place);
    // Until there is light of the kind that is asked for, the last stays.
    if (lighting !== null) this.lighting = lighting;
    const { illumination, modulation } = this.lighting;
    this.modulation = modulation;
    if (lighting !== null) this.level = meanLuminance(withBands(illumination.surround, 1));
    this.light.sampling = value.sampling;
    this.light.behind = this.surroundings.source;
    this.light.set(illumination, value.bands, value.exponent);
    this.placeSubject(value, fields, place);
    this.subject?.dress(value);
    if (this.surroundings.source === "harmonics") this.surroundings.invalidate();
    // The camera's home depends on what there is to be framed.
    const setting = isOfGrid(value.light) ? "grid" : this.near !== null ? "probes" : "afar";
    const moves = setting !== this.setting;
    this.setting = setting;
    if (moves && value.camera === null) this.placeAtHome();
    this.pointArrow(value);
    this.dirty = true;
  }

  /** The light that is asked for; `null` where what it needs has not come yet. Finds out what is near. */
  private lightingOf(value: View, fields: readonly Field[], place: Triple): Lighting | null {
    const probes = this.nearProbes(value);
    if (probes.length === 0) {
      this.near = null;
      if (value.light === "field") return null;
      return illuminate(value.light, this.shown?.coefficients ?? null, fields, {
        place,
        probe: this.probePlace(value),
        gradients: value.gradients,
        before: this.modulation?.method ?? null,
      });
    }
    const own = this.subject?.bounds.radius ?? value.radius;
    const radius = value.size === "true" ? own : value.radius;
    const middle = (value.at ?? middleBetween(probes)) as Triple;
    this.near = { probes, place: middle, radius, problem: "" };
    try {
      return this.nearLight.illuminate(probes, { middle, radius }, value.gradients, this.renderer);
    } catch (error) {
      this.near = { ...this.near, problem: (error as Error).message };
      return null;
    }
  }

  /** The probes whose light depends on the place: a field's, or that of a stream with gradients. */
  private nearProbes(value: View): Probe[] {
    if (value.light === "field") {
      return this.liveField.members.flatMap(({ stream: name }) => {
        const light = this.fieldLights.get(name);
        const position = light?.frame.position ?? null;
        return light === undefined || position === null ? [] : [{ name, position, light }];
      });
    }
    if (value.light !== "stream" || this.shown === null || this.shown.gradients === null) return [];
    return [{ name: value.stream ?? "", position: this.probePlace(value), light: this.shown }];
  }

  private pointArrow({ light, arrow }: View): void {
    const dominant = light === "stream" ? (this.shown?.frame.dominant ?? null) : null;
    this.arrow.visible = arrow && dominant !== null;
    if (dominant === null) return;
    const direction = new Vector3(...dominant.direction);
    const { center, radius } = this.near === null ? this.framed() : new Sphere(new Vector3(...this.near.place), this.near.radius);
    const scale = this.near === null ? 1 : radius / ARROW_OBJECT;
    this.arrow.position.copy(center).addScaledVector(direction, 0.52 * radius + scale * ARROW_LENGTH);
    this.arrow.scale.setScalar(scale);
    this.arrow.setDirection(direction.negate());
    this.arrow.setColor(hue(dominant.irradiance));
  }

  /** Put the object where it belongs, and show the grid around it. */
  private placeSubject(value: View, fields: readonly Field[], place: Triple): void {
    const { subject, volume, near } = this;
    const [first] = fields;
    const movable = !this.probeIsKnown && (near !== null || (value.light === "both" && first !== undefined));
    if (value.probeGizmo && movable) this.probeGizmo.show(this.probePlace(value));
    else this.probeGizmo.hide();
    if (near !== null && value.probes) this.probes.show(near.probes, { middle: near.place, radius: near.radius }, value.bands);
    else this.probes.hide();
    if (near !== null) {
      volume.hide();
      subject?.place(new Vector3(...near.place), near.radius / subject.bounds.radius);
      if (value.gizmo) this.gizmo.show(near.place);
      else this.gizmo.hide();
      return;
    }
    if (first === undefined) {
      volume.hide();
      this.gizmo.hide();
      subject?.place(subject.bounds.center, 1);
      return;
    }
    const fitting = radiusInGrid(first.info);
    const radius = value.size === "true" && subject !== null ? subject.bounds.radius : fitting;
    subject?.place(new Vector3(...place), radius / subject.bounds.radius);
    volume.show(fields, value, { middle: place, radius: 0.9 * radius });
    volume.setGains(this.lighting.illumination.fields.map(({ gain }) => gain));
    if (value.gizmo) this.gizmo.show(place);
    else this.gizmo.hide();
  }

  /** Where the object is: in a grid within the box, in its middle where nothing else is said. */
  private place3({ at, light }: View): Triple {
    const info = isOfGrid(light) ? this.fields[0]?.info : undefined;
    if (info === undefined) return (at ?? this.near?.place ?? [0, 0, 0]) as Triple;
    return (at ?? middleOf(info)).map((value, k) => Math.min(Math.max(value, info.lower[k]!), info.upper[k]!)) as unknown as Triple;
  }

  /** Where the live probe stands: as its frames or its stream say, else as the user says, else in the grid's middle. */
  private probePlace({ probeAt, light }: View): Triple {
    const info = isOfGrid(light) ? this.fields[0]?.info : undefined;
    const known = this.shown?.frame.position ?? this.probeStands;
    return (known ?? probeAt ?? (info === undefined ? [0, 0, 0] : middleOf(info))) as Triple;
  }

  /** Whether the light itself says where its probes stand. */
  private get probeIsKnown(): boolean {
    return view.peek().light === "field" || (this.shown?.frame.position ?? this.probeStands) !== null;
  }

  private moveTo(place: Triple): void {
    change({ at: this.place3({ ...view.peek(), at: place }) });
  }

  private takeFields(fields: readonly Field[]): void {
    const before = this.fields;
    this.fields = fields;
    const gone = before.filter((field) => !fields.includes(field));
    if (this.lighting.illumination.fields.some(({ field }) => gone.includes(field))) {
      this.lighting = { illumination: DARK, modulation: null };
    }
    this.applyLight(view.peek());
    for (const field of gone) field.dispose();
    if (before[0] !== fields[0] && view.peek().camera === null) this.placeAtHome();
  }

  /** Fetch an object and show it; only the last that was asked for is shown. */
  private async show(name: string, load: (signal: AbortSignal) => Promise<Subject>): Promise<void> {
    this.wantedObject = name;
    this.fetchingObject.abort();
    const { signal } = (this.fetchingObject = new AbortController());
    const subject = await load(signal);
    if (signal.aborted) {
      subject.dispose();
      return;
    }
    this.subject?.dispose();
    this.subject = subject;
    this.scene.add(subject.group);
    this.applyLight(view.peek());
    if (view.peek().camera === null) this.placeAtHome();
  }

  /** What the camera frames. */
  private framed(): Sphere {
    const info = this.fields[0]?.info;
    if (this.near !== null) return sphereAround(this.near);
    if (info !== undefined && isOfGrid(view.peek().light)) {
      const { lower, upper } = info;
      const [low, high] = [new Vector3(...lower), new Vector3(...upper)];
      return new Sphere(low.clone().add(high).multiplyScalar(0.5), 0.52 * low.distanceTo(high));
    }
    return this.subject?.bounds ?? BOUNDS;
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
    const { center, radius } = this.framed();
    this.place(center, HOME_DIRECTION, radius);
  }

  /** Look at `target` from `direction`, so far away that the objects fit into the free part of the picture. */
  private place(target: Vector3, direction: Vector3, radius: number): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const halfHeight = Math.tan((FIELD_OF_VIEW_DEGREES * Math.PI) / 360);
    const free = Math.min(width - this.covered.right, (height - this.covered.bottom) * 1.25);
    const halfFree = (halfHeight * free) / height;
    const distance = radius / Math.sin(Math.atan(halfFree));
    this.controls.minDistance = 0.1 * radius;
    this.controls.maxDistance = 22 * radius;
    this.camera.near = 0.02 * radius;
    this.camera.far = 100 * radius;
    this.camera.updateProjectionMatrix();
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
    const hit = raycaster.intersectObjects([...(this.subject?.meshes ?? [])], false)[0];
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

/** The middle of the box about the probes: of one, where it stands. */
function middleBetween(probes: readonly Probe[]): Triple {
  return [0, 1, 2].map((k) => {
    const values = probes.map(({ position }) => position[k]!);
    return (Math.min(...values) + Math.max(...values)) / 2;
  }) as unknown as Triple;
}

/** What is seen of an object and the probes beside it, and of how far these are trusted. */
function sphereAround({ probes, place, radius }: Near): Sphere {
  const trusted = Math.max(...probes.map(({ light }) => light.frame.trust_radius_m ?? 0));
  const sphere = new Sphere(new Vector3(...place), Math.max(1.25 * radius, Math.min(1.1 * trusted, FRAMED_TRUST * radius)));
  for (const { position } of probes) sphere.union(new Sphere(new Vector3(...position), 0.4 * radius));
  return sphere;
}

/** How large an object is shown in a grid: whatever its own size, it is to be seen between the walls. */
function radiusInGrid({ lower, upper }: GridInfo): number {
  const edges = upper.map((high, k) => high - lower[k]!);
  return SIZE_IN_GRID * Math.max(Math.min(...edges), 0.5 * Math.max(...edges));
}
