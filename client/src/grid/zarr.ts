// The little of Zarr v3 that a grid needs: one group, arrays whose chunks are whole tiles, and tables of one chunk. A
// library would bring codecs that grids do not use.

import { NotThere, download } from "../download.ts";

interface Codec {
  name: string;
  configuration?: { endian?: string };
}

interface ArrayDocument {
  node_type: string;
  shape: number[];
  data_type: string;
  chunk_grid: { name: string; configuration: { chunk_shape: number[] } };
  chunk_key_encoding: { name: string; configuration?: { separator?: string } };
  codecs: Codec[];
}

/** A file below a folder's address; what the address asks for (a token) goes along. */
export function below(folder: URL, path: string): URL {
  const url = new URL(folder);
  url.pathname = `${url.pathname.replace(/\/$/, "")}/${path}`;
  return url;
}

/** The attributes of a group. */
export async function readAttributes(folder: URL, signal: AbortSignal): Promise<Record<string, unknown>> {
  const document = (await (await download(below(folder, "zarr.json"), signal)).json()) as {
    attributes?: Record<string, unknown>;
  };
  return document.attributes ?? {};
}

async function readDocument(folder: URL, signal: AbortSignal): Promise<ArrayDocument> {
  return (await (await download(below(folder, "zarr.json"), signal)).json()) as ArrayDocument;
}

/** Whether chunks are packed with gzip; raises `Error` where they are packed with anything else. */
function isZipped(codecs: Codec[]): boolean {
  const [bytes, ...more] = codecs;
  const zipped = more.length === 1 && more[0]!.name === "gzip";
  const { endian } = bytes?.configuration ?? {};
  if (bytes?.name !== "bytes" || (endian !== undefined && endian !== "little") || more.length > (zipped ? 1 : 0)) {
    throw new Error(`The grid is packed with ${codecs.map(({ name }) => name).join(", ")}; the page reads plain and gzip.`);
  }
  return zipped;
}

/** The bytes of a chunk; raises `Error` where there are not as many as expected. */
async function readChunk(url: URL, zipped: boolean, expected: number, signal: AbortSignal): Promise<ArrayBuffer> {
  const response = await download(url, signal);
  const data = zipped
    ? await new Response(response.body!.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer()
    : await response.arrayBuffer();
  if (data.byteLength !== expected) throw new Error(`A file of the grid has ${data.byteLength} bytes, not ${expected}.`);
  return data;
}

const keyOf = ({ shape, chunk_key_encoding: keys }: ArrayDocument, index: number): string =>
  ["c", index, ...shape.slice(1).map(() => 0)].join(keys.configuration?.separator ?? "/");

/** A table of integers in one chunk. */
export async function readWhole(folder: URL, signal: AbortSignal): Promise<Int32Array | Uint8Array> {
  const document = await readDocument(folder, signal);
  const { shape, data_type: type, chunk_grid: grid, codecs } = document;
  if ((type !== "int32" && type !== "uint8") || JSON.stringify(grid.configuration.chunk_shape) !== JSON.stringify(shape)) {
    throw new Error("The grid's tables are not as the page reads them; make it anew.");
  }
  const [Table, size] = type === "int32" ? [Int32Array, 4] : [Uint8Array, 1];
  const count = shape.reduce((product, length) => product * length, 1);
  try {
    return new Table(await readChunk(below(folder, keyOf(document, 0)), isZipped(codecs), size * count, signal));
  } catch (error) {
    // A chunk of nothing but zeros may have no file.
    if (error instanceof NotThere) return new Table(count);
    throw error;
  }
}

/** An array of halves whose every chunk is one index of the first axis. */
export class TileArray {
  private constructor(
    private readonly folder: URL,
    private readonly document: ArrayDocument,
    private readonly zipped: boolean,
  ) {}

  static async open(folder: URL, signal: AbortSignal): Promise<TileArray> {
    const document = await readDocument(folder, signal);
    const { shape, data_type: type, chunk_grid: grid, codecs } = document;
    const expected = [1, ...shape.slice(1)];
    if (type !== "float16" || JSON.stringify(grid.configuration.chunk_shape) !== JSON.stringify(expected)) {
      throw new Error(`The grid's tiles are ${type} in chunks of ${grid.configuration.chunk_shape.join(" × ")}; the page reads float16, a tile a chunk.`);
    }
    return new TileArray(folder, document, isZipped(codecs));
  }

  get shape(): readonly number[] {
    return this.document.shape;
  }

  /** The halves of one tile, as bits. */
  async tile(index: number, signal: AbortSignal): Promise<Uint16Array> {
    const expected = 2 * this.shape.slice(1).reduce((product, size) => product * size, 1);
    return new Uint16Array(await readChunk(below(this.folder, keyOf(this.document, index)), this.zipped, expected, signal));
  }
}
