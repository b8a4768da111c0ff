// The meshes of a finished transfer job: `scene.glb` with their shape, and their transfer in its attributes `_PRT0` … or,
// where those do not fit, in a blob beside it.

import { DataTexture, HalfFloatType, InterleavedBuffer, InterleavedBufferAttribute, Mesh, NearestFilter, RGBAFormat, type BufferGeometry } from "three";

import { apiUrl } from "../api.ts";
import { download } from "../download.ts";
import { LitMaterial, type LightUniforms, type MeshTraits } from "../materials.ts";
import { PAGE_BANDS } from "../sh.ts";
import type { LitMesh } from "../stilllife.ts";
import { Subject, boundsOf } from "./subject.ts";

/** `transfer.json` of a transfer job, as far as the page reads it. */
interface Description {
  version: number;
  bands: number;
  channels: 1 | 3;
  meshes: { name: string; vertices: number; float16: string; stride: number }[];
  glb: string;
}

const MOST_TEXELS = 4096;
const NUMBERED = /^_prt(\d)$/i;

/** Load the meshes of a job. Raises `Error` with the reason in words. */
export async function loadTransfer(job: string, light: LightUniforms, signal: AbortSignal): Promise<Subject> {
  const description = (await (await artifact(job, "transfer.json", signal)).json()) as Description;
  if (description.version !== 1) {
    throw new Error(`The transfer's description has version ${description.version}; reload this page.`);
  }
  const [{ GLTFLoader }, data] = await Promise.all([
    import("three/addons/loaders/GLTFLoader.js"),
    artifact(job, description.glb, signal).then((response) => response.arrayBuffer()),
  ]);
  const { scene } = await new GLTFLoader().parseAsync(data, "");
  const found: Mesh<BufferGeometry>[] = [];
  scene.updateMatrixWorld(true);
  scene.traverse((node) => {
    if (node instanceof Mesh) found.push(node as Mesh<BufferGeometry>);
  });
  if (found.length !== description.meshes.length) {
    throw new Error(`${description.glb} has ${found.length} meshes, transfer.json ${description.meshes.length}; run the job anew.`);
  }
  const meshes = await Promise.all(
    found.map(async (mesh, k) => {
      const { float16, vertices, stride, name } = description.meshes[k]!;
      const { geometry } = mesh;
      if (geometry.getAttribute("position").count !== vertices) {
        throw new Error(`The mesh ${name} has another number of vertices than its transfer; run the job anew.`);
      }
      geometry.applyMatrix4(mesh.matrixWorld);
      turnUp(geometry);
      if (!geometry.hasAttribute("normal")) geometry.computeVertexNormals();
      const baked = description.channels === 1 && takeBaked(geometry);
      const transfer = baked
        ? ({ bands: Math.min(description.bands, PAGE_BANDS), from: "attributes", scale: 1 } as const)
        : attach(geometry, description, stride, await halves(job, float16, vertices * stride, signal));
      return litMesh(geometry, name, light, { transfer, coloured: geometry.hasAttribute("color") });
    }),
  );
  return new Subject(meshes, boundsOf(meshes));
}

function litMesh(geometry: BufferGeometry, name: string, light: LightUniforms, traits: MeshTraits): LitMesh {
  const mesh = new Mesh(geometry, new LitMaterial(light, traits));
  mesh.name = name;
  return mesh;
}

/** glTF has +Y up, the world +Z: (x, y, z) becomes (x, −z, y). */
function turnUp(geometry: BufferGeometry): void {
  geometry.rotateX(Math.PI / 2);
}

/** Rename attributes `_prt0` …, as the loader calls them, to what the shader reads. */
function takeBaked(geometry: BufferGeometry): boolean {
  const names = Object.keys(geometry.attributes).filter((name) => NUMBERED.test(name));
  for (const name of names) {
    geometry.setAttribute(`transfer${NUMBERED.exec(name)![1]}`, geometry.getAttribute(name));
    geometry.deleteAttribute(name);
  }
  return names.length > 0;
}

async function halves(job: string, path: string, count: number, signal: AbortSignal): Promise<Uint16Array> {
  const data = await (await artifact(job, path, signal)).arrayBuffer();
  if (data.byteLength !== 2 * count) throw new Error(`${path} has ${data.byteLength} bytes, not ${2 * count}; run the job anew.`);
  return new Uint16Array(data);
}

/** Give the geometry transfer from a blob: as attributes where they are scalars, else as a texture. */
function attach(
  geometry: BufferGeometry,
  { bands, channels }: Description,
  stride: number,
  values: Uint16Array,
): NonNullable<MeshTraits["transfer"]> {
  const used = Math.min(bands, PAGE_BANDS);
  const count = used * used;
  if (channels === 1) {
    const buffer = new InterleavedBuffer(values, stride);
    // Three asks the buffer whether its bits are halves; not every browser has an array of halves.
    Object.assign(buffer, { isFloat16BufferAttribute: true });
    for (let slot = 0; 4 * slot < count; slot++) {
      const attribute = new InterleavedBufferAttribute(buffer, Math.min(4, count - 4 * slot), 4 * slot);
      geometry.setAttribute(`transfer${slot}`, attribute);
    }
    return { bands: used, from: "attributes", scale: 1 };
  }
  return { bands: used, from: "texture", scale: 1, ...transferTable(values, stride, count) };
}

/** Pack three-coloured transfer into a texture, `count` texels a vertex, as many vertices a row as fit whole. */
export function transferTable(values: Uint16Array, stride: number, count: number): { table: DataTexture; perRow: number } {
  const vertices = values.length / stride;
  const perRow = Math.min(vertices, Math.floor(MOST_TEXELS / count));
  const rows = Math.ceil(vertices / perRow);
  const texels = new Uint16Array(4 * rows * perRow * count);
  for (let vertex = 0; vertex < vertices; vertex++) {
    for (let i = 0; i < count; i++) {
      const from = stride * vertex + 3 * i;
      texels.set(values.subarray(from, from + 3), 4 * (count * vertex + i));
    }
  }
  const table = new DataTexture(texels, perRow * count, rows, RGBAFormat, HalfFloatType);
  table.minFilter = table.magFilter = NearestFilter;
  table.needsUpdate = true;
  return { table, perRow };
}

/** A file of a job's results. Raises `Error` with the reason in words. */
async function artifact(job: string, path: string, signal: AbortSignal): Promise<Response> {
  // An artefact is named by its job and its file, without the last ending.
  const name = `${job}.${path.replace(/\.[^.]*$/, "")}`;
  return download(apiUrl(document.baseURI, `artifacts/${encodeURIComponent(name)}`), signal);
}
