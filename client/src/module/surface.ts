// Materials of the module: what they look like, and the transfer that a mesh brings along.

import { Color, type BufferGeometry, type ColorRepresentation, type Material, type Mesh } from "three";

import { LitMaterial, type LightUniforms, type MeshTraits } from "../materials.ts";
import type { Variant } from "../shader.ts";

/** How a surface looks. */
export interface SurfaceOptions {
  /** Albedo; white by default. */
  color?: ColorRepresentation;
  /** 0 (default): matte. 1: only the Phong lobe. */
  gloss?: number;
  /** Whether a mesh with baked transfer (`_PRT0` …, as the job `prt-transfer` writes it) shades itself; true by default. */
  shadows?: boolean;
}

const NUMBERED = /^_prt(\d)$/i;

/** Take attributes `_PRT0` …, as three's GLTFLoader names them, for the material's transfer. */
function takeTransfer(geometry: BufferGeometry): MeshTraits["transfer"] {
  for (const name of Object.keys(geometry.attributes)) {
    const slot = NUMBERED.exec(name)?.[1];
    if (slot === undefined) continue;
    geometry.setAttribute(`transfer${slot}`, geometry.getAttribute(name));
    geometry.deleteAttribute(name);
  }
  const slots = Object.keys(geometry.attributes).filter((name) => name.startsWith("transfer")).length;
  // 1, 4, 9, 16 and 25 coefficients take 1, 1, 3, 4 and 7 slots; one slot is taken for two bands.
  const bands = slots === 0 ? 0 : [2, 2, 2, 3, 4, 4, 4, 5][Math.min(slots, 7)]!;
  return bands === 0 ? null : { bands, from: "attributes", scale: 1 };
}

/** Materials of one light. */
export class Surfaces {
  private readonly members = new Map<LitMaterial, boolean>();

  constructor(
    private readonly uniforms: LightUniforms,
    private readonly axes: Variant["axes"],
  ) {}

  /** Give the mesh a material of this light, and dispose of the one that it had. */
  illuminate(mesh: Mesh, options: SurfaceOptions): void {
    const transfer = takeTransfer(mesh.geometry);
    const material = new LitMaterial(this.uniforms, { transfer, coloured: mesh.geometry.hasAttribute("color") }, this.axes);
    material.surface.albedo.copy(new Color(options.color ?? "#ffffff"));
    material.surface.gloss = options.gloss ?? 0;
    this.members.set(material, options.shadows ?? true);
    material.addEventListener("dispose", () => this.members.delete(material));
    for (const before of [mesh.material].flat() as Material[]) before.dispose();
    mesh.material = material;
    material.refresh(options.shadows ?? true);
  }

  /** The light is of another kind now: other shaders may be needed. */
  refresh(): void {
    for (const [material, shadows] of this.members) material.refresh(shadows);
  }

  dispose(): void {
    for (const material of [...this.members.keys()]) material.dispose();
  }
}
