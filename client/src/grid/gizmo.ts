// Handles that move the object through the grid. They are fetched when they are first wanted.

import { Group, Object3D, Vector3, type PerspectiveCamera } from "three";
import type { TransformControls } from "three/addons/controls/TransformControls.js";

import type { Vector3 as Triple } from "../sh.ts";

export interface GizmoEvents {
  /** Dragging has begun or ended: the camera must not turn meanwhile. */
  drag: (active: boolean) => void;
  move: (place: Triple) => void;
  /** The handles look different now. */
  changed: () => void;
}

export class Gizmo {
  readonly group = new Group();
  private readonly handle = new Object3D();
  private controls: TransformControls | null = null;
  private wanted = false;
  private loading = false;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLCanvasElement,
    private readonly events: GizmoEvents,
  ) {
    this.group.add(this.handle);
  }

  show(place: Triple): void {
    this.wanted = true;
    if (this.controls?.dragging !== true) this.handle.position.copy(new Vector3(...place));
    if (this.controls === null) void this.load();
    else this.apply();
  }

  hide(): void {
    this.wanted = false;
    this.apply();
  }

  private apply(): void {
    const { controls } = this;
    if (controls === null) return;
    controls.enabled = controls.getHelper().visible = this.wanted;
    if (this.wanted && controls.object !== this.handle) controls.attach(this.handle);
    if (!this.wanted) controls.detach();
  }

  private async load(): Promise<void> {
    if (this.loading) return;
    this.loading = true;
    const { TransformControls } = await import("three/addons/controls/TransformControls.js");
    const controls = new TransformControls(this.camera, this.canvas);
    controls.setSize(0.7);
    controls.addEventListener("dragging-changed", ({ value }) => this.events.drag(value === true));
    controls.addEventListener("objectChange", () => {
      const { x, y, z } = this.handle.position;
      this.events.move([x, y, z]);
    });
    controls.addEventListener("change", () => this.events.changed());
    this.controls = controls;
    this.group.add(controls.getHelper());
    this.apply();
    this.events.changed();
  }
}
