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
  const file = name === "bunny" ? "bunny.bin" : "scene.bin";
  const { bunny, ball, table } = await loadStillLife(new URL(file, document.baseURI).href, light);
  table!.material.surface.albedo.set(TABLE.colour);
  if (ball === undefined) return new Subject([bunny!, table!], new Sphere(new Vector3(0.1, -0.06, 0.44), 1.85), [bunny!]);
  ball.material.surface.albedo.set(BALL.colour);
  ball.material.surface.gloss = BALL.gloss;
  return new Subject([bunny!, ball, table!], BOUNDS, [bunny!]);
}
