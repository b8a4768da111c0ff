// GLSL that evaluates spherical harmonics. The code is straight-line, made by unrolling the recurrence of `sh.basis`:
// indexing an array with a loop variable made the fragment shader three times slower.

import { PAGE_BANDS, diagonal, recurrence } from "./sh.ts";

export function literal(value: number): string {
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

/** Declare floats `name0` … with the values of the basis functions of `bands` bands at the unit vector `d`. */
export function basisValues(name: string, d: string, bands: number): string {
  const lines: string[] = [];
  const start = diagonal(bands);
  for (let m = 0; m < bands; m++) {
    const [c, s] = [`${name}c${m}`, `${name}s${m}`];
    const [before, sBefore] = [`${name}c${m - 1}`, `${name}s${m - 1}`];
    if (m === 1) lines.push(`float ${c} = ${d}.x, ${s} = ${d}.y;`);
    if (m > 1) {
      lines.push(`float ${c} = ${d}.x * ${before} - ${d}.y * ${sBefore}, ${s} = ${d}.x * ${sBefore} + ${d}.y * ${before};`);
    }
    let previous = "";
    let current = literal(start[m]!);
    for (let l = m; l < bands; l++) {
      if (l > m) {
        const { a, b } = recurrence(l, m);
        const value = previous === "" ? `${d}.z * ${current}` : `(${d}.z * ${current} - ${literal(b)} * ${previous})`;
        lines.push(`float ${name}q${l}_${m} = ${literal(a)} * ${value};`);
        [previous, current] = [current, `${name}q${l}_${m}`];
      }
      const at = l * l + l;
      lines.push(`float ${name}${at + m} = ${current}${m === 0 ? "" : ` * ${c}`};`);
      if (m > 0) lines.push(`float ${name}${at - m} = ${current} * ${s};`);
    }
  }
  return lines.join("\n  ");
}

/**
 * `vec3 pictured(vec3 direction)`: radiance from the backdrop's picture. It is much coarser than the screen, so it is
 * enlarged by a cubic B-spline, made of four bilinear samples; the log curve of wire.Backdrop is undone. Row 0 is +Z.
 */
export const PICTURED = /* glsl */ `
uniform sampler2D picture;
uniform vec2 pictureSize;
uniform float pictureK;
uniform float pictureCap;
vec3 sampledSmoothly(vec2 uv) {
  vec2 position = uv * pictureSize - 0.5;
  vec2 f = fract(position);
  vec2 base = position - f;
  vec2 f2 = f * f;
  vec2 f3 = f2 * f;
  vec2 w0 = (1.0 - 3.0 * f + 3.0 * f2 - f3) / 6.0;
  vec2 w1 = (4.0 - 6.0 * f2 + 3.0 * f3) / 6.0;
  vec2 w3 = f3 / 6.0;
  vec2 g0 = w0 + w1;
  vec2 g1 = 1.0 - g0;
  vec2 lower = (base - 0.5 + w1 / g0) / pictureSize;
  vec2 upper = (base + 1.5 + w3 / g1) / pictureSize;
  return g0.y * (g0.x * texture2D(picture, lower).rgb + g1.x * texture2D(picture, vec2(upper.x, lower.y)).rgb)
    + g1.y * (g0.x * texture2D(picture, vec2(lower.x, upper.y)).rgb + g1.x * texture2D(picture, upper).rgb);
}
vec3 pictured(vec3 d) {
  vec2 uv = vec2(atan(d.y, d.x) / 6.28318530718, acos(clamp(d.z, -1.0, 1.0)) / 3.14159265359);
  return (exp2(sampledSmoothly(uv) * log2(1.0 + pictureK * pictureCap)) - 1.0) / pictureK;
}`;
