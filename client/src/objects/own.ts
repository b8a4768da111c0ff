// The objects that come with the page.

import { Sphere, Vector3 } from "three";

import type { LightUniforms } from "../materials.ts";
import { BOUNDS, loadStillLife } from "../stilllife.ts";
import { sphereOnGround } from "./shapes.ts";
import { Subject } from "./subject.ts";

const BALL = { colour: "#ffffff", gloss: 0.92 };
const TABLE = { colour: "#77736d" };

export type OwnObject = "stilllife" | "bunny" | "sphere";

export async function loadOwnObject(name: OwnObject, light: LightUniforms): Promise<Subject> {
  if (name === "sphere") return sphereOnGround(light);
  const { bunny, ball, table } = await loadStillLife(new URL("scene.bin", document.baseURI).href, light);
  if (name === "bunny") return new Subject([bunny], new Sphere(new Vector3(-0.3, 0.05, 0.75), 1.1));
  ball.material.surface.albedo.set(BALL.colour);
  ball.material.surface.gloss = BALL.gloss;
  table.material.surface.albedo.set(TABLE.colour);
  return new Subject([bunny, ball, table], BOUNDS, [bunny]);
}
