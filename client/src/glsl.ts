// GLSL that evaluates spherical harmonics. The code is straight-line, made by unrolling the recurrence of `sh.basis`:
// indexing an array with a loop variable made the fragment shader three times slower.

import { PAGE_BANDS, diagonal, recurrence } from "./sh.ts";

function literal(value: number): string {
  const text = String(Number(value.toPrecision(9)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/**
 * Return a function `vec3 name(vec3 d)` that evaluates `bands` bands of the uniform `vec3 coefficients[]` at the unit
 * vector `d`.
 */
export function harmonics(name: string, coefficients: string, bands: number): string {
  const lines: string[] = [];
  const start = diagonal(bands);
  const at = (l: number, m: number) => `${coefficients}[${l * l + l + m}]`;
  const add = (value: string, l: number, m: number) => {
    if (m === 0) lines.push(`sum += ${value} * ${at(l, 0)};`);
    else lines.push(`sum += ${value} * (c${m} * ${at(l, m)} + s${m} * ${at(l, -m)});`);
  };
  for (let m = 0; m < bands; m++) {
    if (m === 1) lines.push("float c1 = d.x, s1 = d.y;");
    if (m > 1) lines.push(`float c${m} = d.x * c${m - 1} - d.y * s${m - 1}, s${m} = d.x * s${m - 1} + d.y * c${m - 1};`);
    add(literal(start[m]!), m, m);
    let previous = "";
    let current = literal(start[m]!);
    for (let l = m + 1; l < bands; l++) {
      const { a, b } = recurrence(l, m);
      const value = previous === "" ? `d.z * ${current}` : `(d.z * ${current} - ${literal(b)} * ${previous})`;
      lines.push(`float q${l}_${m} = ${literal(a)} * ${value};`);
      add(`q${l}_${m}`, l, m);
      [previous, current] = [current, `q${l}_${m}`];
    }
  }
  return [`vec3 ${name}(vec3 d) {`, "vec3 sum = vec3(0.0);", ...lines, "return sum;", "}"].join("\n  ").replace(/ {2}}$/, "}");
}

/**
 * `vec3 withoutNegatives(vec3)`: truncated harmonics ring below zero. Move such a colour towards its luminance just so
 * far that no channel is negative; clipping the channels would turn dark places blue or red.
 */
export const WITHOUT_NEGATIVES = /* glsl */ `
vec3 withoutNegatives(vec3 rgb) {
  float smallest = min(rgb.r, min(rgb.g, rgb.b));
  float luminance = max(dot(rgb, vec3(0.2126, 0.7152, 0.0722)), 0.0);
  float keep = smallest < 0.0 ? luminance / (luminance - smallest) : 1.0;
  return luminance + keep * (rgb - luminance);
}`;

/** How many vec4 attributes carry the transfer coefficients of a vertex. */
export const TRANSFER_SLOTS = Math.ceil((PAGE_BANDS * PAGE_BANDS) / 4);

/** Return a function `vec3 name()` that sums transfer coefficients (attributes `transfer0` …) times the light. */
export function transferred(name: string, coefficients: string): string {
  const terms = Array.from({ length: PAGE_BANDS * PAGE_BANDS }, (_, i) => {
    return `transfer${i >> 2}.${"xyzw"[i & 3]} * ${coefficients}[${i}]`;
  });
  const attributes = Array.from({ length: TRANSFER_SLOTS }, (_, slot) => `attribute vec4 transfer${slot};`);
  return [...attributes, `vec3 ${name}() {`, `  return ${terms.join(" +\n    ")};`, "}"].join("\n");
}
