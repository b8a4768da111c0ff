// What is seen of grids: the first one's box, the slice that is looked at, and on it sample spheres lit by all of them.

import {
  BufferAttribute,
  BufferGeometry,
  Group,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  ShaderMaterial,
  SphereGeometry,
} from "three";

import { WITHOUT_NEGATIVES, basisValues, literal } from "../glsl.ts";
import type { LightUniforms } from "../materials.ts";
import { lambertFactors, withBands, type Vector3 } from "../sh.ts";
import type { Axis, View } from "../view.ts";
import type { Field } from "./field.ts";
import type { GridInfo } from "./info.ts";

/** Bands that make a matte sphere: the fourth weighs a hundredth, and the third nothing. */
const BANDS = 3;
/** Numbers of a sphere: middle, radius, 27 coefficients, one to spare. */
const STRIDE = 32;
const LANES = STRIDE / 4;
/** Spheres along the slice's longer edge, at most. */
const MOST_ALONG = 12;
/** Radius of a sphere, of the distance to the next. */
const SHARE = 0.2;

const number = (i: number): string => `lane${i >> 2}.${"xyzw"[i & 3]}`;
const factors = lambertFactors(BANDS);
const sum = Array.from({ length: BANDS * BANDS }, (_, i) => {
  const colour = [0, 1, 2].map((channel) => number(4 + 3 * i + channel)).join(", ");
  return `${literal(factors[Math.floor(Math.sqrt(i))]!)} * n${i} * (vec3(${colour}) + rest[${i}])`;
}).join(" +\n    ");

const VERTEX = /* glsl */ `
${Array.from({ length: LANES }, (_, lane) => `attribute vec4 lane${lane};`).join("\n")}
uniform vec3 rest[25];
varying vec3 irradiance;
void main() {
  ${basisValues("n", "position", BANDS)}
  irradiance = ${sum};
  gl_Position = projectionMatrix * viewMatrix * vec4(lane0.xyz + lane0.w * position, 1.0);
}`;

const FRAGMENT = /* glsl */ `
varying vec3 irradiance;
${WITHOUT_NEGATIVES}
void main() {
  gl_FragColor = vec4(withoutNegatives(irradiance) * 0.9 / 3.14159265359, 1.0);
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}`;

const AXES: Axis[] = ["x", "y", "z"];

/** Middles of the sample spheres on a slice, and their radius. */
export function samplePlaces({ lower, upper, resolution }: GridInfo, axis: Axis, slice: number): { places: Vector3[]; radius: number } {
  const across = AXES.indexOf(axis);
  const edges = [0, 1, 2].filter((k) => k !== across) as [number, number];
  const extent = edges.map((k) => upper[k]! - lower[k]!) as [number, number];
  // As near to squares as the box allows, and not more than there are cells.
  const step = Math.max(...extent) / MOST_ALONG;
  const counts = edges.map((k, i) => Math.max(1, Math.min(Math.round(extent[i]! / step), resolution[k]!))) as [number, number];
  const radius = SHARE * Math.min(extent[0] / counts[0], extent[1] / counts[1]);
  const places: Vector3[] = [];
  for (let j = 0; j < counts[1]; j++) {
    for (let i = 0; i < counts[0]; i++) {
      const place: [number, number, number] = [0, 0, 0];
      place[across] = lower[across]! + slice * (upper[across]! - lower[across]!);
      place[edges[0]] = lower[edges[0]]! + ((i + 0.5) / counts[0]) * extent[0];
      place[edges[1]] = lower[edges[1]]! + ((j + 0.5) / counts[1]) * extent[1];
      places.push(place);
    }
  }
  return { places, radius };
}

export class Volume {
  readonly group = new Group();
  private readonly box = lines(0x9aa3ad, 0.7);
  private readonly frame = lines(0xe2a54a, 0.8);
  /** Filled anew with each move: buffers that are replaced would fill the GPU's memory until they are collected. */
  private readonly buffer = new InstancedInterleavedBuffer(new Float32Array(STRIDE * MOST_ALONG * MOST_ALONG), STRIDE);
  private readonly spheres: Mesh<InstancedBufferGeometry, ShaderMaterial>;
  private shown = "";
  private places: Vector3[] = [];
  private radius = 0;
  /** The light of each field at each place. */
  private looked: Float32Array[][] = [];
  private gains = "";

  constructor(private readonly light: LightUniforms) {
    const sphere = new SphereGeometry(1, 16, 11);
    const geometry = new InstancedBufferGeometry();
    geometry.index = sphere.index;
    geometry.setAttribute("position", sphere.getAttribute("position"));
    for (let lane = 0; lane < LANES; lane++) {
      geometry.setAttribute(`lane${lane}`, new InterleavedBufferAttribute(this.buffer, 4, 4 * lane));
    }
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { rest: light.light },
    });
    this.spheres = new Mesh(geometry, material);
    this.spheres.frustumCulled = this.box.frustumCulled = this.frame.frustumCulled = false;
    this.group.add(this.box, this.frame, this.spheres);
    this.group.visible = false;
  }

  /** Show the first field's box and slice; spheres that the object would cover (a ball of `clear`) are left out. */
  show(
    fields: readonly Field[],
    { sliceAxis: axis, slice, probes, gradients }: Pick<View, "sliceAxis" | "slice" | "probes" | "gradients">,
    clear: { middle: Vector3; radius: number } | null,
  ): void {
    this.group.visible = true;
    this.spheres.visible = probes;
    const key = JSON.stringify([fields.map(({ atlas }) => atlas.texture.id), axis, slice, probes, gradients, clear]);
    if (key === this.shown) return;
    this.shown = key;
    const { lower, upper } = fields[0]!.info;
    setEdges(this.box, lower, upper);
    const k = AXES.indexOf(axis);
    const at = lower[k]! + slice * (upper[k]! - lower[k]!);
    const flat = (corner: Vector3) => corner.map((value, i) => (i === k ? at : value)) as unknown as Vector3;
    setEdges(this.frame, flat(lower), flat(upper));
    if (!probes) return;
    const { places, radius } = samplePlaces(fields[0]!.info, axis, slice);
    this.radius = radius;
    this.places = places.filter((place) => clear === null || distance(place, clear.middle) > clear.radius + radius);
    this.looked = fields.map((field) => this.places.map((place) => withBands(field.sample(place, gradients), BANDS)));
    this.gains = "";
  }

  hide(): void {
    this.group.visible = false;
    this.shown = "";
  }

  /** The fields are multiplied with that. */
  setGains(gains: readonly Vector3[]): void {
    this.spheres.material.uniforms["rest"]!.value = this.light.light.value;
    const key = JSON.stringify(gains);
    if (key === this.gains || !this.spheres.visible) return;
    this.gains = key;
    const data = this.buffer.array as Float32Array;
    this.places.forEach((place, i) => {
      data.set([...place, this.radius], STRIDE * i);
      for (let j = 0; j < 3 * BANDS * BANDS; j++) {
        data[STRIDE * i + 4 + j] = this.looked.reduce((sum, light, k) => sum + gains[k]![j % 3]! * light[i]![j]!, 0);
      }
    });
    this.buffer.needsUpdate = true;
    this.spheres.geometry.instanceCount = this.places.length;
  }
}

function lines(color: number, opacity: number): LineSegments {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(3 * 24), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color, transparent: true, opacity }));
}

function setEdges({ geometry }: LineSegments, lower: Vector3, upper: Vector3): void {
  const position = geometry.getAttribute("position");
  (position.array as Float32Array).set(edgesOf(lower, upper));
  position.needsUpdate = true;
}

function distance(a: Vector3, b: Vector3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** The twelve edges of a box as pairs of corners. */
function edgesOf(lower: Vector3, upper: Vector3): number[] {
  const corner = (bits: number) => [0, 1, 2].map((k) => ((bits >> k) & 1 ? upper : lower)[k]!);
  const points: number[] = [];
  for (let bits = 0; bits < 8; bits++) {
    for (let k = 0; k < 3; k++) if (((bits >> k) & 1) === 0) points.push(...corner(bits), ...corner(bits | (1 << k)));
  }
  return points;
}
