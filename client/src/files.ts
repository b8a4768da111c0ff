// Which files the page takes, and what it calls them.

import { bytes } from "./jobs/words.ts";

const MESHES = ["glb", "gltf", "obj", "ply"];
const MAPS = ["exr", "hdr"];
export const ACCEPTED = [...MESHES, ...MAPS].map((ending) => `.${ending}`).join(",");

/** Why a file is not taken, in words; empty where it is. */
export function refusal(name: string, size: number, largest: number | null = null): string {
  const ending = endingOf(name);
  if (["jpg", "jpeg", "png", "webp", "tif", "tiff"].includes(ending)) {
    return `A .${ending} picture lacks the range of real light: use a lat-long map as .exr or .hdr.`;
  }
  if (![...MESHES, ...MAPS].includes(ending)) {
    return "This is neither a mesh (.glb, .obj, .ply) nor a lat-long map (.exr, .hdr).";
  }
  if (size === 0) return "The file is empty.";
  if (largest === null || size <= largest) return "";
  const remedy = MESHES.includes(ending) ? "simplify the mesh" : "shrink the map";
  return `The file has ${bytes(size)}, and the server takes at most ${bytes(largest)}: ${remedy}.`;
}

function endingOf(name: string): string {
  return name.includes(".") ? name.split(".").at(-1)!.toLowerCase() : "";
}

/** A stream's name from a file's. */
export function streamName(file: string): string {
  const stem = file.replace(/\.[^.]*$/, "").toLowerCase().normalize("NFKD").replace(/[^a-z0-9_-]+/g, "-");
  return stem.replace(/^[^a-z0-9]+|-+$/g, "").slice(0, 50) || "map";
}

/** What becomes of a file: an object, or light. */
export function kindOfFile(name: string): "mesh" | "map" {
  return MAPS.includes(endingOf(name)) ? "map" : "mesh";
}
