// The types that the module ships, against a page as a stranger would write it.

import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

import { expect, it } from "vitest";

import { TSC, declarations } from "../../tools/declarations.ts";

const USER = `
import * as THREE from "three";
import { LightwellGrid, LightwellProbe, type GridOptions, type SurfaceOptions } from "lightwell";

const renderer = new THREE.WebGLRenderer();
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera();
const mesh = new THREE.Mesh(new THREE.TorusKnotGeometry());
const look: SurfaceOptions = { color: "#d8d2c8", gloss: 0.3, shadows: false };
const options: GridOptions = { token: "t", yUp: true, sampling: "vertex", gradients: false, onProgress: (share) => share.toFixed() };

const probe = new LightwellProbe("http://127.0.0.1:8400", "room", { exponent: 20 });
scene.add(probe.light, mesh);
probe.illuminate(mesh, look);
const red: number | undefined = probe.coefficients?.[0];
if (probe.state.connection === "refused") console.error(probe.state.problem, red);

const grid = await LightwellGrid.load("http://127.0.0.1:8400/api/v1/artifacts/JOB.grid", renderer, options);
grid.illuminate(mesh);
grid.setGain(1, 0.5, 2);
grid.sample(grid.box.getCenter(mesh.position)).getAt(new THREE.Vector3(0, 1, 0), new THREE.Vector3());
renderer.setAnimationLoop(() => (probe.update() ? renderer.render(scene, camera) : undefined));
probe.dispose();
grid.dispose();

// @ts-expect-error: there is no such option.
probe.illuminate(mesh, { colour: "red" });
// @ts-expect-error: grids are loaded.
new LightwellGrid();
// @ts-expect-error: no such state.
probe.state.connection === "lost";
`;

it("compiles a stranger's page against the types that the module ships", { timeout: 120_000 }, () => {
  const text = declarations();
  expect(text).not.toMatch(/private (?!constructor)|from "\.|LightUniforms|LiveStream/);
  // Within the client's folder, so that three and its types are found.
  const folder = mkdtempSync(join(fileURLToPath(new URL("../../node_modules", import.meta.url)), ".types-"));
  try {
    writeFileSync(join(folder, "lightwell-three.d.ts"), text);
    writeFileSync(join(folder, "page.ts"), USER);
    const compilerOptions = {
      strict: true,
      noEmit: true,
      target: "ES2022",
      module: "ESNext",
      moduleResolution: "bundler",
      lib: ["ES2022", "DOM"],
      types: [],
      skipLibCheck: false,
      paths: { lightwell: ["./lightwell-three.d.ts"] },
    };
    writeFileSync(join(folder, "tsconfig.json"), JSON.stringify({ compilerOptions, files: ["page.ts"] }));
    const run = () => execFileSync(process.execPath, [TSC, "-p", folder], { encoding: "utf-8" });
    let said = "";
    try {
      said = run();
    } catch (error) {
      said = (error as { stdout: string }).stdout;
    }
    expect(said).toBe("");
  } finally {
    rmSync(folder, { recursive: true });
  }
});
