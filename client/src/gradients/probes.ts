// Live probes in the picture: small spheres where they stand, lit by what they see, and how far their light can be
// trusted.

import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments, Mesh, SphereGeometry } from "three";

import { LightUniforms, LitMaterial } from "../materials.ts";
import { minus } from "./matrix.ts";
import type { Probe, Spot } from "./near.ts";

const SEGMENTS = 96;
/** Radius of a sphere, of the object's. */
const SHARE = 0.16;
/** A probe nearer to the object's middle than this share of its radius would stick out of the object: it is not shown. */
const CLEAR = 0.6;
const COLOUR = 0xe2a54a;

interface Shown {
  group: Group;
  sphere: Mesh<SphereGeometry, LitMaterial>;
  ring: LineSegments<BufferGeometry, LineBasicMaterial>;
  light: LightUniforms;
}

export class Probes {
  readonly group = new Group();
  private readonly shown: Shown[] = [];
  private readonly geometry = new SphereGeometry(1, 24, 16);
  private readonly circles = threeCircles();

  /** Show probes beside an object there. */
  show(probes: readonly Probe[], { middle, radius }: Spot, bands: number): void {
    while (this.shown.length < probes.length) this.add();
    this.shown.forEach(({ group, sphere, ring, light }, k) => {
      const probe = probes[k];
      group.visible = probe !== undefined;
      if (probe === undefined) return;
      const { coefficients, frame } = probe.light;
      light.set({ distant: coefficients, fields: [], gradients: false, surround: coefficients }, bands, 1);
      sphere.material.refresh(false);
      sphere.visible = Math.hypot(...minus(probe.position, middle)) > CLEAR * radius;
      group.position.set(...probe.position);
      sphere.scale.setScalar(SHARE * radius);
      const trust = frame.trust_radius_m;
      ring.visible = trust !== null && trust > 0;
      if (ring.visible) ring.scale.setScalar(trust!);
    });
  }

  hide(): void {
    for (const { group } of this.shown) group.visible = false;
  }

  private add(): void {
    const light = new LightUniforms();
    const sphere = new Mesh(this.geometry, new LitMaterial(light));
    sphere.material.surface.albedo.setScalar(0.9);
    const ring = new LineSegments(this.circles, new LineBasicMaterial({ color: COLOUR, transparent: true, opacity: 0.55 }));
    const group = new Group();
    group.add(sphere, ring);
    this.group.add(group);
    this.shown.push({ group, sphere, ring, light });
  }
}

/** Unit circles across the three axes. */
function threeCircles(): BufferGeometry {
  const points: number[] = [];
  for (let axis = 0; axis < 3; axis++) {
    for (let k = 0; k < SEGMENTS; k++) {
      for (const step of [k, k + 1]) {
        const angle = (2 * Math.PI * step) / SEGMENTS;
        const point = [0, 0, 0];
        point[(axis + 1) % 3] = Math.cos(angle);
        point[(axis + 2) % 3] = Math.sin(angle);
        points.push(...point);
      }
    }
  }
  return new BufferGeometry().setAttribute("position", new BufferAttribute(Float32Array.from(points), 3));
}
