// How long a picture takes with each kind of light and surface: bench/page.py opens this page and reads the figures. The
// scene is the page's own, at 512 × 384 pixels; a pixel is read back, so that the time holds all of the drawing.

import { PerspectiveCamera, Scene, WebGLRenderTarget, WebGLRenderer } from "three";

import { Field, arrange } from "./grid/field.ts";
import type { GridInfo } from "./grid/info.ts";
import { tileCount } from "./grid/layout.ts";
import { LightUniforms, type Illumination } from "./materials.ts";
import { loadOwnObject } from "./objects/own.ts";
import { PAGE_BANDS, withBands } from "./sh.ts";
import { DEFAULT_VIEW, type View } from "./view.ts";

const WIDTH = 512;
const HEIGHT = 384;
const ROUNDS = 9;
const CELLS = 64;
const HALF_OF_ONE = 0x3800; // 0.5 as a half

interface Kind {
  name: string;
  grid: boolean;
  view: Partial<View>;
}

const KINDS: Kind[] = [
  { name: "diffuse", grid: false, view: { shadows: false, gloss: 0 } },
  { name: "glossy", grid: false, view: { shadows: false, gloss: 0.5 } },
  { name: "PRT", grid: false, view: { shadows: true, gloss: 0 } },
  { name: "PRT, glossy, mirror", grid: false, view: { shadows: true, gloss: 0.5, mirror: 0.5 } },
  { name: "grid by vertex, PRT", grid: true, view: { shadows: true, gloss: 0, sampling: "vertex" } },
  { name: "grid by vertex, PRT, glossy", grid: true, view: { shadows: true, gloss: 0.5, sampling: "vertex" } },
  { name: "grid by fragment, diffuse of 9", grid: true, view: { shadows: false, gloss: 0, sampling: "fragment", bands: 3 } },
  { name: "grid by fragment, PRT", grid: true, view: { shadows: true, gloss: 0, sampling: "fragment" } },
  { name: "grid by fragment, PRT, glossy", grid: true, view: { shadows: true, gloss: 0.5, sampling: "fragment" } },
];

function someField(): Field {
  const info: GridInfo = {
    id: "frames",
    lower: [-2, -2, -0.5],
    upper: [2, 2, 2],
    resolution: [CELLS, CELLS, CELLS],
    bands: PAGE_BANDS,
    units: "relative",
    scale: 1,
    bytes: 0,
  };
  const tiles = Array.from({ length: tileCount(PAGE_BANDS) }, (_, tile) => {
    return new Uint16Array(4 * CELLS ** 3).fill(tile < 3 ? HALF_OF_ONE : 0);
  });
  return new Field(info, PAGE_BANDS, arrange(info, { largest: 2048, bytes: 2 ** 30 }), tiles);
}

function median(values: number[]): number {
  return values.toSorted((a, b) => a - b)[values.length >> 1]!;
}

async function measure(): Promise<{ renderer: string; ms: Record<string, number> }> {
  const renderer = new WebGLRenderer({ canvas: new OffscreenCanvas(WIDTH, HEIGHT), antialias: false });
  renderer.setSize(WIDTH, HEIGHT, false);
  const gl = renderer.getContext();
  const named = gl.getExtension("WEBGL_debug_renderer_info");
  const light = new LightUniforms();
  const subject = await loadOwnObject("stilllife", light);
  subject.place(subject.bounds.center, 1);
  const scene = new Scene();
  scene.add(subject.group);
  const camera = new PerspectiveCamera(36, WIDTH / HEIGHT, 0.05, 100);
  camera.up.set(0, 0, 1);
  camera.position.set(0.9, -3.8, 1.7);
  camera.lookAt(0.12, -0.08, 0.45);
  const field = someField();
  field.upload(renderer);
  const distant = withBands(Float32Array.from({ length: 75 }, (_, i) => (i < 3 ? 2 : 0.2 * Math.sin(i))), PAGE_BANDS);
  const target = new WebGLRenderTarget(WIDTH, HEIGHT, { samples: 0 });
  const pixel = new Uint8Array(4);

  const draw = ({ grid, view }: Kind): number => {
    const wanted: View = { ...DEFAULT_VIEW, ...view };
    const illumination: Illumination = {
      distant: grid ? null : distant,
      field: grid ? field : null,
      gain: [1, 1, 1],
      surround: distant,
    };
    light.sampling = wanted.sampling;
    light.set(illumination, wanted.bands, wanted.exponent);
    subject.dress(wanted);
    // All of the still life looks alike, so that the kinds can be compared.
    for (const { material } of subject.meshes) {
      Object.assign(material.surface, { gloss: wanted.gloss, mirror: wanted.mirror });
      material.refresh(wanted.shadows);
    }
    const start = performance.now();
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(target, WIDTH >> 1, HEIGHT >> 1, 1, 1, pixel);
    return performance.now() - start;
  };

  const times = new Map<string, number[]>(KINDS.map(({ name }) => [name, []]));
  // The first round compiles. Kinds take turns, so that a drift of the machine hits all alike.
  for (let round = 0; round <= ROUNDS; round++) {
    for (const kind of KINDS) {
      const ms = draw(kind);
      if (round > 0) times.get(kind.name)!.push(ms);
      await new Promise((resolve) => setTimeout(resolve));
    }
  }
  const ms = Object.fromEntries([...times].map(([name, values]) => [name, median(values)]));
  return { renderer: String(gl.getParameter(named?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER)), ms };
}

const output = document.getElementById("result")!;
measure().then(
  (result) => {
    output.textContent = JSON.stringify(result, null, 1);
    output.dataset["done"] = "true";
  },
  (error: unknown) => {
    output.textContent = String(error);
    output.dataset["done"] = "false";
  },
);
