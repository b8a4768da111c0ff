// The little of Zarr v3 that a grid needs: one group, one array whose chunks are whole tiles. A library would bring codecs
// that grids do not use.

import { download } from "../download.ts";

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

/** An array of halves whose every chunk is one index of the first axis. */
export class TileArray {
  private constructor(
    private readonly folder: URL,
    readonly shape: readonly number[],
    private readonly separator: string,
    private readonly zipped: boolean,
  ) {}

  static async open(folder: URL, signal: AbortSignal): Promise<TileArray> {
    const document = (await (await download(below(folder, "zarr.json"), signal)).json()) as ArrayDocument;
    const { shape, data_type: type, chunk_grid: grid, chunk_key_encoding: keys, codecs } = document;
    const expected = [1, ...shape.slice(1)];
    if (type !== "float16" || JSON.stringify(grid.configuration.chunk_shape) !== JSON.stringify(expected)) {
      throw new Error(`The grid's tiles are ${type} in chunks of ${grid.configuration.chunk_shape.join(" × ")}; the page reads float16, a tile a chunk.`);
    }
    const [bytes, ...more] = codecs;
    const zipped = more.length === 1 && more[0]!.name === "gzip";
    if (bytes?.name !== "bytes" || bytes.configuration?.endian !== "little" || more.length > (zipped ? 1 : 0)) {
      throw new Error(`The grid's tiles are packed with ${codecs.map(({ name }) => name).join(", ")}; the page reads plain and gzip.`);
    }
    return new TileArray(folder, shape, keys.configuration?.separator ?? "/", zipped);
  }

  /** The halves of one tile, as bits. */
  async tile(index: number, signal: AbortSignal): Promise<Uint16Array> {
    const key = ["c", index, ...this.shape.slice(1).map(() => 0)].join(this.separator);
    const response = await download(below(this.folder, key), signal);
    const data = this.zipped
      ? await new Response(response.body!.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer()
      : await response.arrayBuffer();
    const expected = 2 * this.shape.slice(1).reduce((product, size) => product * size, 1);
    if (data.byteLength !== expected) throw new Error(`A tile of the grid has ${data.byteLength} bytes, not ${expected}.`);
    return new Uint16Array(data);
  }
}
