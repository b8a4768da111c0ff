// How long a picture takes with each kind of light and surface: bench/page.py opens this page and reads the figures. The
// scene is the page's own, at 512 × 384 pixels; a pixel is read back, so that the time holds all of the drawing.

import { PerspectiveCamera, Scene, WebGLRenderTarget, WebGLRenderer } from "three";

import { Atlas } from "./grid/atlas.ts";
import { STEPS } from "./grid/bricks.ts";
import { Field } from "./grid/field.ts";
import type { GridInfo } from "./grid/info.ts";
import { BrickLattice, RegularLattice } from "./grid/lattice.ts";
import { tileCount } from "./grid/layout.ts";
import { arrange, arrangeBends } from "./grid/load.ts";
import { LightUniforms, type Illumination } from "./materials.ts";
import { loadOwnObject } from "./objects/own.ts";
import { PAGE_BANDS, withBands } from "./sh.ts";
import { DEFAULT_VIEW, type View } from "./view.ts";

const WIDTH = 512;
const HEIGHT = 384;
const ROUNDS = 5;
const CELLS = 64;
const HALF_OF_ONE = 0x3800; // 0.5 as a half

interface Kind {
  name: string;
  fields: readonly Field[];
  view: Partial<View>;
}

const PRT: Partial<View> = { shadows: true, gloss: 0 };
const BY_VERTEX: Partial<View> = { ...PRT, sampling: "vertex" };
const BY_FRAGMENT: Partial<View> = { ...PRT, sampling: "fragment" };

function kinds(): Kind[] {
  const plain = someField({ bends: false });
  const bent = someField({ bends: true });
  const bricks = someBricks();
  const two = [plain, someField({ bends: false })];
  const four = [...two, someField({ bends: false }), someField({ bends: false })];
  return [
    { name: "diffuse", fields: [], view: { shadows: false, gloss: 0 } },
    { name: "glossy", fields: [], view: { shadows: false, gloss: 0.5 } },
    { name: "PRT", fields: [], view: PRT },
    { name: "PRT, glossy, mirror", fields: [], view: { shadows: true, gloss: 0.5, mirror: 0.5 } },
    { name: "grid by vertex, PRT", fields: [plain], view: BY_VERTEX },
    { name: "grid by vertex, PRT, glossy", fields: [plain], view: { ...BY_VERTEX, gloss: 0.5 } },
    { name: "grid by vertex, PRT, gradients", fields: [bent], view: BY_VERTEX },
    { name: "grid by vertex, PRT, adaptive", fields: [bricks], view: BY_VERTEX },
    { name: "two light groups by vertex, PRT", fields: two, view: BY_VERTEX },
    { name: "four light groups by vertex, PRT", fields: four, view: BY_VERTEX },
    { name: "grid by fragment, diffuse of 9", fields: [plain], view: { ...BY_FRAGMENT, shadows: false, bands: 3 } },
    { name: "grid by fragment, PRT", fields: [plain], view: BY_FRAGMENT },
    { name: "grid by fragment, PRT, glossy", fields: [plain], view: { ...BY_FRAGMENT, gloss: 0.5 } },
    { name: "grid by fragment, PRT, gradients", fields: [bent], view: BY_FRAGMENT },
    { name: "grid by fragment, PRT, adaptive", fields: [bricks], view: BY_FRAGMENT },
    { name: "two light groups by fragment, PRT", fields: two, view: BY_FRAGMENT },
  ];
}

const LIMITS = { largest: 2048, bytes: 2 ** 30 };
const INFO: GridInfo = {
  id: "frames",
  lower: [-2, -2, -0.5],
  upper: [2, 2, 2],
  resolution: [CELLS, CELLS, CELLS],
  bands: PAGE_BANDS,
  units: "relative",
  slots: null,
  scale: 1,
  bendScale: 1,
  bytes: 0,
};

/** Tiles with the same light everywhere. */
function someTiles(texels: number, sets = 1): Uint16Array[] {
  const [dark, lit] = [0, HALF_OF_ONE].map((value) => new Uint16Array(4 * texels).fill(value));
  return Array.from({ length: sets * tileCount(PAGE_BANDS) }, (_, tile) => (tile < 3 ? lit! : dark!));
}

function someField({ bends }: { bends: boolean }): Field {
  const lattice = new RegularLattice(INFO);
  const atlas = new Atlas(arrange(INFO, LIMITS), lattice.tile, someTiles(CELLS ** 3));
  const more = bends ? new Atlas(arrangeBends(INFO, LIMITS)!, lattice.tile, someTiles(CELLS ** 3, 3)) : null;
  return new Field(INFO, PAGE_BANDS, lattice, atlas, more);
}

/** A grid of the same size as bricks, none of them coarse. */
function someBricks(): Field {
  const blocks = Math.ceil((CELLS - 1) / STEPS);
  const info: GridInfo = { ...INFO, slots: [blocks, blocks, blocks], bendScale: null };
  const lattice = new BrickLattice(info, Int32Array.from({ length: blocks ** 3 }, (_, i) => i), new Uint8Array(blocks ** 3));
  return new Field(info, PAGE_BANDS, lattice, new Atlas(arrange(info, LIMITS), lattice.tile, someTiles((blocks * 5) ** 3)), null);
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
  const all = kinds();
  for (const field of new Set(all.flatMap(({ fields }) => fields))) field.upload(renderer);
  const distant = withBands(Float32Array.from({ length: 75 }, (_, i) => (i < 3 ? 2 : 0.2 * Math.sin(i))), PAGE_BANDS);
  const target = new WebGLRenderTarget(WIDTH, HEIGHT, { samples: 0 });
  const pixel = new Uint8Array(4);

  const draw = ({ fields, view }: Kind): number => {
    const wanted: View = { ...DEFAULT_VIEW, ...view };
    const illumination: Illumination = {
      distant: fields.length > 0 ? null : distant,
      fields: fields.map((field) => ({ field, gain: [1, 1, 1] })),
      gradients: true,
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

  const times = new Map<string, number[]>(all.map(({ name }) => [name, []]));
  // The first round compiles. Kinds take turns, so that a drift of the machine hits all alike.
  for (let round = 0; round <= ROUNDS; round++) {
    for (const kind of all) {
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
