// What is lit: some meshes, of which one or more take the colour and the gloss that the user chooses.

import { Box3, Group, Sphere, Vector3 } from "three";

import type { LitMesh } from "../stilllife.ts";
import { DEFAULT_VIEW, type View } from "../view.ts";

export class Subject {
  readonly group = new Group();

  constructor(
    readonly meshes: readonly LitMesh[],
    /** What the camera frames, in the object's own axes and metres. */
    readonly bounds: Sphere,
    /** Meshes that look as the user wants; the others keep their material. */
    private readonly chosen: readonly LitMesh[] = meshes,
  ) {
    this.group.add(...meshes);
  }

  /** Put the middle of the object there, at that scale. */
  place(middle: Vector3, scale: number): void {
    this.group.scale.setScalar(scale);
    this.group.position.copy(middle).addScaledVector(this.bounds.center, -scale);
    this.group.updateMatrixWorld(true);
  }

  /** Take over colour and gloss, and what the light needs. */
  dress(view: View): void {
    for (const mesh of this.chosen) {
      const { surface, traits } = mesh.material;
      // A mesh with colours of its own is tinted only where the user has chosen a colour.
      if (traits.coloured && view.colour === DEFAULT_VIEW.colour) surface.albedo.setScalar(1);
      else surface.albedo.set(view.colour);
      surface.gloss = view.gloss;
      surface.mirror = view.mirror;
    }
    for (const { material } of this.meshes) material.refresh(view.shadows);
  }

  dispose(): void {
    this.group.removeFromParent();
    for (const { geometry, material } of this.meshes) {
      geometry.dispose();
      material.traits.transfer?.table?.dispose();
      material.dispose();
    }
  }
}

/** The sphere around all meshes, in the axes of the group. */
export function boundsOf(meshes: readonly LitMesh[]): Sphere {
  const box = new Box3();
  for (const mesh of meshes) box.expandByObject(mesh);
  return box.isEmpty() ? new Sphere(new Vector3(), 1) : box.getBoundingSphere(new Sphere());
}
