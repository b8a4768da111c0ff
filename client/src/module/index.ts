/**
 * Lightwell's light in other people's three.js pages: `LightwellProbe` for the live light of a stream, `LightwellGrid`
 * for a light field. See docs/module.md and example.html.
 *
 * @packageDocumentation
 */
export { LightwellGrid, type GridOptions } from "./grid.ts";
export { LightwellProbe, type ProbeOptions } from "./probe.ts";
export type { SurfaceOptions } from "./surface.ts";
