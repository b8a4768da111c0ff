// The lit objects: a bunny, a ball (not in each file) and a round table, baked by tools/bake_scene.py with their diffuse
// transfer.

import { BufferAttribute, BufferGeometry, InterleavedBuffer, InterleavedBufferAttribute, Mesh, Sphere, Vector3 } from "three";

import { TRANSFER_SLOTS } from "./glsl.ts";
import { LitMaterial, type LightUniforms } from "./materials.ts";

export type PartName = "bunny" | "ball" | "table";

export type LitMesh = Mesh<BufferGeometry, LitMaterial>;

interface Header {
  vertices: number;
  bands: number;
  scales: { position: number; normal: number; transfer: number };
  parts: { name: PartName; start: number; count: number }[];
}

const LANES = 36;
const FIRST_LANE = { position: 0, normal: 4, transfer: 8 };

/** What the camera frames, world axes. */
export const BOUNDS = new Sphere(new Vector3(0.12, -0.08, 0.5), 1.82);

/** Fetch the file and make one mesh a part; raises `Error` where it cannot be had. */
export async function loadStillLife(url: string, light: LightUniforms): Promise<Partial<Record<PartName, LitMesh>>> {
  const response = await fetch(url);
  if (!response.ok || response.body === null) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  const unzipped = response.body.pipeThrough(new DecompressionStream("gzip"));
  const data = await new Response(unzipped).arrayBuffer();

  const headerBytes = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, headerBytes))) as Header;
  const lanes = new Int16Array(data, 4 + headerBytes, LANES * header.vertices);
  const triangles = new Uint16Array(data, lanes.byteOffset + lanes.byteLength);

  const buffer = new InterleavedBuffer(lanes, LANES);
  const attribute = (size: number, lane: number) => new InterleavedBufferAttribute(buffer, size, lane, true);
  const index = new BufferAttribute(triangles, 1);
  const transfer = { bands: header.bands, from: "attributes", scale: header.scales.transfer } as const;
  const meshes = header.parts.map(({ name, start, count }) => {
    const geometry = new BufferGeometry();
    geometry.setIndex(index);
    geometry.setDrawRange(start, count);
    geometry.setAttribute("position", attribute(3, FIRST_LANE.position));
    geometry.setAttribute("normal", attribute(3, FIRST_LANE.normal));
    for (let slot = 0; slot < TRANSFER_SLOTS; slot++) {
      geometry.setAttribute(`transfer${slot}`, attribute(4, FIRST_LANE.transfer + 4 * slot));
    }
    const mesh = new Mesh(geometry, new LitMaterial(light, { transfer, coloured: false }));
    mesh.name = name;
    mesh.scale.setScalar(header.scales.position);
    mesh.frustumCulled = false;
    return [name, mesh] as const;
  });
  return Object.fromEntries(meshes) as Partial<Record<PartName, LitMesh>>;
}
