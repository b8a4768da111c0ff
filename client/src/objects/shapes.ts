// A sphere on a round ground. Their transfer is made here by quadrature: a ray against a sphere or a disc is one formula.

import { BufferAttribute, BufferGeometry, InterleavedBuffer, InterleavedBufferAttribute, Mesh, Sphere, Vector3 as ThreeVector } from "three";

import { TRANSFER_SLOTS } from "../glsl.ts";
import { LitMaterial, type LightUniforms } from "../materials.ts";
import { PAGE_BANDS, basis, type Vector3 } from "../sh.ts";
import { Subject } from "./subject.ts";

const RADIUS = 0.6;
const GROUND_RADIUS = 1.7;
const GROUND = { colour: "#77736d" };
const DIRECTIONS = 900;

export interface Patch {
  position: Vector3;
  normal: Vector3;
}

/** Nearly even directions. */
export function fibonacci(count: number): Vector3[] {
  return Array.from({ length: count }, (_, i) => {
    const z = 1 - (2 * i + 1) / count;
    const azimuth = Math.PI * (1 + Math.sqrt(5)) * i;
    const r = Math.sqrt(1 - z * z);
    return [r * Math.cos(azimuth), r * Math.sin(azimuth), z];
  });
}

/** Share of the ground's light that the sphere lets through: 0 or 1. */
function clearOfSphere([x, y, z]: Vector3, [u, v, w]: Vector3): boolean {
  const [px, py, pz] = [x, y, z - RADIUS];
  const towards = -(px * u + py * v + pz * w);
  return towards <= 0 || px * px + py * py + pz * pz - towards * towards > RADIUS * RADIUS;
}

function clearOfGround([x, y, z]: Vector3, [u, v, w]: Vector3): boolean {
  if (w >= 0) return true;
  const t = -z / w;
  return (x + t * u) ** 2 + (y + t * v) ** 2 > GROUND_RADIUS * GROUND_RADIUS;
}

/** Transfer `t_lm = ∫ V max(0, n·ω) Y_lm dω` [§9] of every patch, `slots · 4` numbers each. */
export function transferOf(patches: readonly Patch[], clear: (at: Vector3, towards: Vector3) => boolean): Float32Array {
  const directions = fibonacci(DIRECTIONS);
  const count = PAGE_BANDS * PAGE_BANDS;
  const values = directions.map((direction) => basis(direction, PAGE_BANDS));
  const stride = 4 * TRANSFER_SLOTS;
  const transfer = new Float32Array(stride * patches.length);
  patches.forEach(({ position, normal }, vertex) => {
    directions.forEach((direction, k) => {
      const cosine = normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * direction[2];
      if (cosine <= 0 || !clear(position, direction)) return;
      const weight = (cosine * 4 * Math.PI) / DIRECTIONS;
      const row = values[k]!;
      for (let i = 0; i < count; i++) transfer[stride * vertex + i]! += weight * row[i]!;
    });
  });
  return transfer;
}

/** Patches of a surface of revolution, ring by ring, and the triangles between them. */
function revolve(profile: { r: number; z: number; nr: number; nz: number }[], segments: number): [Patch[], number[]] {
  const patches: Patch[] = [];
  const triangles: number[] = [];
  profile.forEach(({ r, z, nr, nz }, ring) => {
    for (let s = 0; s < segments; s++) {
      const [c, d] = [Math.cos((2 * Math.PI * s) / segments), Math.sin((2 * Math.PI * s) / segments)];
      patches.push({ position: [r * c, r * d, z], normal: [nr * c, nr * d, nz] });
      if (ring === 0) continue;
      const a = (ring - 1) * segments + s;
      const b = (ring - 1) * segments + ((s + 1) % segments);
      triangles.push(a, b, b + segments, a, b + segments, a + segments);
    }
  });
  return [patches, triangles];
}

function litMesh(light: LightUniforms, [patches, triangles]: [Patch[], number[]], clear: typeof clearOfSphere): Mesh<BufferGeometry, LitMaterial> {
  const geometry = new BufferGeometry();
  geometry.setIndex(triangles);
  geometry.setAttribute("position", new BufferAttribute(Float32Array.from(patches.flatMap(({ position }) => position)), 3));
  geometry.setAttribute("normal", new BufferAttribute(Float32Array.from(patches.flatMap(({ normal }) => normal)), 3));
  const buffer = new InterleavedBuffer(transferOf(patches, clear), 4 * TRANSFER_SLOTS);
  for (let slot = 0; slot < TRANSFER_SLOTS; slot++) {
    geometry.setAttribute(`transfer${slot}`, new InterleavedBufferAttribute(buffer, 4, 4 * slot));
  }
  return new Mesh(geometry, new LitMaterial(light, { transfer: { bands: PAGE_BANDS, from: "attributes", scale: 1 }, coloured: false }));
}

/** A sphere that stands on a round ground. */
export function sphereOnGround(light: LightUniforms): Subject {
  const rings = 40;
  const ball = revolve(
    Array.from({ length: rings + 1 }, (_, i) => {
      const theta = Math.PI - (Math.PI * i) / rings;
      const [nr, nz] = [Math.sin(theta), Math.cos(theta)];
      return { r: RADIUS * nr, z: RADIUS + RADIUS * nz, nr, nz };
    }),
    56,
  );
  // Rings are closer where the shadow is sharper.
  const ground = revolve(
    Array.from({ length: 31 }, (_, i) => ({ r: GROUND_RADIUS * (1 - i / 30) ** 1.3, z: 0, nr: 0, nz: 1 })),
    56,
  );
  const sphere = litMesh(light, ball, clearOfGround);
  const disc = litMesh(light, ground, clearOfSphere);
  disc.material.surface.albedo.set(GROUND.colour);
  return new Subject([sphere, disc], new Sphere(new ThreeVector(0, 0, 0.45), 1.75), [sphere]);
}
