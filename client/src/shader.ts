// The shaders of every lit surface. Each variant is text of its own, straight-line and without what it does not need:
// no branch, no dynamic index. Three compiles them as GLSL ES 3.00.

import { STEPS } from "./grid/bricks.ts";
import { tileCount } from "./grid/layout.ts";
import { PICTURED, WITHOUT_NEGATIVES, basisValues, harmonics, literal } from "./glsl.ts";
import { PAGE_BANDS, lambertFactors } from "./sh.ts";

const COUNT = PAGE_BANDS * PAGE_BANDS;
/** Bands up to which nine coefficients make all of the irradiance: Lambert's factor of degree 3 is zero. */
const FEW_BANDS = 4;
/** π Y₀₀: the transfer t₀₀ of an open surface. */
const OPEN_TRANSFER = 0.886226925;
/** Texture units and attributes that every WebGL 2 has; the software renderer has more and would not complain. */
export const MOST_TEXTURES = 16;
export const MOST_ATTRIBUTES = 16;
export const MOST_VARYINGS = 15;

/** A field of coefficients in 3D textures: see `grid/layout.ts`. */
export interface MemberVariant {
  /** `cells`: of one lattice; `bricks`: of an adaptive grid, see `grid/lattice.ts`. */
  form: "cells" | "bricks";
  /** Bands that the texture holds. */
  stored: number;
  /** Tiles beside each other in the atlas. */
  columns: number;
  /** The same in the atlas of what gradients add; `null`: it is not looked up. */
  bendColumns: number | null;
}

/** Fields that add up, each with a gain of its own. */
export interface FieldVariant {
  /** Where they are looked up. */
  sampling: "vertex" | "fragment";
  members: readonly MemberVariant[];
}

export interface TransferVariant {
  bands: number;
  /** `attributes`: one value a coefficient; `texture`: red, green and blue, fetched by the vertex's number. */
  from: "attributes" | "texture";
}

export interface Variant {
  /** Bands of light that are drawn, 1 … 5. */
  bands: number;
  /** Whether the same light comes from afar to every place. */
  distant: boolean;
  field: FieldVariant | null;
  transfer: TransferVariant | null;
  glossy: boolean;
  mirror: "none" | "picture" | "harmonics";
  /** Whether the mesh has colours of its own. */
  coloured: boolean;
  /** Axes of the page: light and transfer are always in those of Lightwell, +Z up. */
  axes: "lightwell" | "three";
}

export interface ShaderText {
  vertexShader: string;
  fragmentShader: string;
}

const slotsOf = (count: number): number => Math.ceil(count / 4);
const lane = (prefix: string, i: number): string => `${prefix}${i >> 2}.${"xyzw"[i & 3]}`;
const range = (count: number): number[] => Array.from({ length: count }, (_, i) => i);

/** What a variant comes down to where it asks for what cannot be. */
export function normalised(variant: Variant): Variant {
  const { field, transfer } = variant;
  // Three colours of transfer do not fit through between the shaders: look the field up where they are.
  if (field?.sampling === "fragment" && transfer?.from === "texture") {
    return { ...variant, field: { ...field, sampling: "vertex" } };
  }
  return variant;
}

/** Bands that some of the fields hold, as far as they are drawn. */
const bandsHeld = ({ bands, field }: Variant): number =>
  Math.min(bands, Math.max(...(field?.members.map(({ stored }) => stored) ?? [PAGE_BANDS])));

/** What the matte part reads, as weights of the coefficients; `null` where a weight is zero. */
interface Matte {
  lines: string;
  weights: (string | null)[];
  /** Whether the weights are colours. */
  coloured: boolean;
}

function matteOf(variant: Variant, normal: string, transfer: string): Matte {
  const bands = bandsHeld(variant);
  if (variant.transfer !== null) {
    const used = Math.min(bands, variant.transfer.bands) ** 2;
    const coloured = variant.transfer.from === "texture";
    const weight = (i: number) => (coloured ? `rgb${i}` : lane(transfer, i));
    return { lines: "", weights: range(COUNT).map((i) => (i < used ? weight(i) : null)), coloured };
  }
  const needed = bands > FEW_BANDS ? bands : Math.min(bands, 3);
  const factors = lambertFactors(PAGE_BANDS);
  const weights = range(COUNT).map((i) => {
    const factor = factors[Math.floor(Math.sqrt(i))]!;
    return i < needed * needed && Math.abs(factor) > 1e-9 ? `${literal(factor)} * n${i}` : null;
  });
  return { lines: basisValues("n", normal, needed), weights, coloured: false };
}

/** Sum the fields with the weights of the matte and the glossy part: `fieldMatte`, `fieldGlossy`. */
function fieldSums(variant: Variant, field: FieldVariant, place: string, matte: Matte, gloss: boolean): string {
  const lines = [matte.lines, "vec3 fieldMatte = vec3(0.0), fieldGlossy = vec3(0.0);"];
  field.members.forEach((member, k) => lines.push(...memberSums(variant, member, k, place, matte, gloss)));
  return lines.filter((line) => line !== "").join("\n  ");
}

/** The same of one of them; each of its texels is fetched once. */
function memberSums(variant: Variant, member: MemberVariant, k: number, place: string, matte: Matte, gloss: boolean): string[] {
  const bands = Math.min(variant.bands, member.stored);
  const used = bands * bands;
  const stored = member.stored * member.stored;
  const groups = stored >> 2;
  const dull = (i: number) => (i < used ? matte.weights[i]! : null);
  const shiny = (i: number) => (gloss && i < used ? `lobe[${Math.floor(Math.sqrt(i))}] * r${i}` : null);
  const [name, own] = [`field${k}`, `f${k}`];
  const fetch = fetcher(member, name, own);
  const lines = [`vec3 ${own} = ${name}Place(${place});`, `vec3 ${own}Matte = vec3(0.0), ${own}Glossy = vec3(0.0);`];
  if (member.bendColumns !== null) {
    lines.push(
      `vec3 ${own}Steps = ${name}Steps(${place});`,
      `vec3 ${own}Low = max(min(floor(${own}Steps), ${name}Cells - 2.0), vec3(0.0));`,
      `vec3 ${own}Part = ${own}Steps - ${own}Low;`,
      `vec3 ${own}Bend = ${name}BendScale * ${own}Part * (1.0 - ${own}Part);`,
      `vec3 ${own}Middle = (${own}Steps + 0.5) * ${name}BendTexel;`,
      `vec3 ${own}Still = (${own}Low + 0.5) * ${name}BendTexel;`,
      // The lower node along one axis, filtered along the others.
      `vec3 ${own}X = vec3(${own}Still.x, ${own}Middle.yz);`,
      `vec3 ${own}Y = vec3(${own}Middle.x, ${own}Still.y, ${own}Middle.z);`,
      `vec3 ${own}Z = vec3(${own}Middle.xy, ${own}Still.z);`,
    );
  }
  for (let group = 0; group < groups; group++) {
    const lanes = [0, 1, 2, 3].map((i) => 4 * group + i);
    const [dulls, shinies] = [lanes.map(dull), lanes.map(shiny)];
    if ([...dulls, ...shinies].every((weight) => weight === null)) continue;
    for (const [c, colour] of ["R", "G", "B"].entries()) {
      lines.push(`vec4 ${own}${colour}${group} = ${fetch(3 * group + c)};`);
    }
    const add = (sum: string, weights: (string | null)[]) => {
      if (weights.every((weight) => weight === null)) return;
      lines.push(`vec4 ${sum}${group} = vec4(${weights.map((weight) => weight ?? "0.0").join(", ")});`);
      lines.push(`${sum} += vec3(${["R", "G", "B"].map((c) => `dot(${sum}${group}, ${own}${c}${group})`).join(", ")});`);
    };
    if (!matte.coloured) add(`${own}Matte`, dulls);
    else {
      dulls.forEach((weight, i) => {
        const colour = ["R", "G", "B"].map((c) => `${own}${c}${group}.${"xyzw"[i]}`).join(", ");
        if (weight !== null) lines.push(`${own}Matte += ${weight} * vec3(${colour});`);
      });
    }
    add(`${own}Glossy`, shinies);
  }
  if (stored % 4 === 1 && used === stored) {
    const last = stored - 1;
    if (dull(last) !== null || gloss) lines.push(`vec3 ${own}Last = (${fetch(3 * groups)}).rgb;`);
    if (dull(last) !== null) lines.push(`${own}Matte += ${dull(last)} * ${own}Last;`);
    if (gloss) lines.push(`${own}Glossy += ${shiny(last)} * ${own}Last;`);
  }
  lines.push(`fieldMatte += ${name}Gain * ${own}Matte;`);
  if (gloss) lines.push(`fieldGlossy += ${name}Gain * ${own}Glossy;`);
  return lines;
}

/** How a tile's texel is fetched at the place that `own` names, with what the gradients add. */
function fetcher({ stored, columns, bendColumns }: MemberVariant, name: string, own: string): (tile: number) => string {
  const at = (texture: string, step: string, place: string, tile: number, wide: number) => {
    const offset = `vec2(${literal(tile % wide)}, ${literal(Math.floor(tile / wide))})`;
    return `textureLod(${texture}, vec3(${place}.xy + ${offset} * ${step}, ${place}.z), 0.0)`;
  };
  const tiles = tileCount(stored);
  return (tile) => {
    const plain = at(name, `${name}Step`, own, tile, columns);
    if (bendColumns === null) return plain;
    const bends = ["X", "Y", "Z"].map((axis, k) => {
      const bend = at(`${name}Bends`, `${name}BendStep`, `${own}${axis}`, k * tiles + tile, bendColumns);
      return `${own}Bend.${axis.toLowerCase()} * ${bend}`;
    });
    return [plain, ...bends].join(" + ");
  };
}

/** Uniforms and places of the fields. */
function fieldHead({ members }: FieldVariant, gloss: boolean): string {
  const texts = members.map((member, k) => memberHead(member, `field${k}`));
  return [...texts, gloss ? `uniform float lobe[${PAGE_BANDS}];` : ""].join("\n");
}

function memberHead({ form, bendColumns }: MemberVariant, name: string): string {
  const lines = [
    `uniform highp sampler3D ${name};`,
    ...["Lower", "PerMetre", "Cells", "Texel", "Gain"].map((part) => `uniform vec3 ${name}${part};`),
    `uniform vec2 ${name}Step;`,
    // Steps from the centre of the first cell. Within those of the outermost, tiles do not bleed into each other.
    `vec3 ${name}Steps(vec3 p) { return clamp((p - ${name}Lower) * ${name}PerMetre - 0.5, vec3(0.0), ${name}Cells - 1.0); }`,
  ];
  if (bendColumns !== null) {
    lines.push(
      `uniform highp sampler3D ${name}Bends;`,
      `uniform vec3 ${name}BendTexel;`,
      `uniform vec2 ${name}BendStep;`,
      `uniform float ${name}BendScale;`,
    );
  }
  if (form === "cells") {
    lines.push(`vec3 ${name}Place(vec3 p) { return (${name}Steps(p) + 0.5) * ${name}Texel; }`);
  } else {
    lines.push(
      `uniform highp usampler3D ${name}Pages;`,
      `uniform vec3 ${name}LastBlock;`,
      `uniform vec3 ${name}Depths;`,
      `uniform vec3 ${name}Nodes;`,
      `vec3 ${name}Place(vec3 p) {`,
      `  vec3 steps = ${name}Steps(p);`,
      `  ivec3 block = ivec3(min(floor(steps / ${literal(STEPS)}), ${name}LastBlock));`,
      `  uvec4 page = texelFetch(${name}Pages, block, 0);`,
      `  ivec3 span = ivec3(1) << min(ivec3(int(page.w)), ivec3(${name}Depths));`,
      `  vec3 local = steps / vec3(span) - ${literal(STEPS)} * vec3(block / span);`,
      `  return (vec3(page.xyz) * ${name}Nodes + local + 0.5) * ${name}Texel;`,
      "}",
    );
  }
  return lines.join("\n");
}

const toLight = (axes: Variant["axes"]): string =>
  `vec3 toLight(vec3 v) { return ${axes === "three" ? "vec3(v.x, -v.z, v.y)" : "v"}; }`;

/** The matte part of three-coloured transfer, which is fetched, not declared. */
function fetchedTransfer(transfer: TransferVariant): string {
  const count = transfer.bands * transfer.bands;
  const lines = range(count).map((i) => `vec3 rgb${i} = texelFetch(transferTable, cell + ivec2(${i}, 0), 0).rgb;`);
  return [
    `ivec2 cell = ivec2((gl_VertexID % transferPerRow) * ${count}, gl_VertexID / transferPerRow);`,
    ...lines,
  ].join("\n  ");
}

/** Return the shaders of a variant. */
export function litShader(wanted: Variant): ShaderText {
  const variant = normalised(wanted);
  return { vertexShader: vertexText(variant), fragmentShader: fragmentText(variant) };
}

function vertexText(variant: Variant): string {
  const { transfer, field, distant, glossy, coloured } = variant;
  const fieldHere = field?.sampling === "vertex" ? field : null;
  const fromTexture = transfer?.from === "texture";
  const count = transfer === null ? 0 : transfer.bands * transfer.bands;
  const used = transfer === null ? 0 : Math.min(variant.bands, transfer.bands) ** 2;
  const slots = transfer?.from === "attributes" ? range(slotsOf(count)) : [];
  const handOver = field?.sampling === "fragment" ? range(slotsOf(used)) : [];
  const head: string[] = [];
  const body: string[] = [];

  for (const slot of slots) head.push(`attribute vec4 transfer${slot};`);
  if (fromTexture) head.push("uniform highp sampler2D transferTable;", "uniform int transferPerRow;");
  if (transfer !== null) head.push("uniform float transferScale;", "varying float visibility;");
  if (coloured) head.push("attribute vec3 color;", "varying vec3 own;");
  head.push("varying vec3 worldPosition;", "varying vec3 worldNormal;");
  if (transfer !== null || fieldHere !== null) head.push("varying vec3 irradiance;");
  if (fieldHere !== null && glossy) head.push("varying vec3 fieldShine;");
  for (const slot of handOver) head.push(`varying vec4 passed${slot};`);
  if (transfer !== null && distant) head.push(`uniform vec3 light[${COUNT}];`);
  if (fieldHere !== null) head.push(fieldHead(fieldHere, glossy));
  head.push(toLight(variant.axes));

  body.push(
    "vec4 world = modelMatrix * vec4(position, 1.0);",
    "worldPosition = world.xyz;",
    // World normal under any transformation of the mesh: the view's rotation is undone again.
    "worldNormal = (vec4(normalMatrix * normal, 0.0) * viewMatrix).xyz;",
    "gl_Position = projectionMatrix * viewMatrix * world;",
  );
  if (coloured) body.push("own = color;");
  if (fromTexture) body.push(fetchedTransfer(transfer));
  if (transfer !== null) {
    const open = fromTexture ? "dot(rgb0, vec3(1.0 / 3.0))" : "transfer0.x";
    // Share of the cosine-weighted hemisphere that is open.
    body.push(`visibility = transferScale * ${open} / ${OPEN_TRANSFER};`);
  }
  if (transfer !== null || fieldHere !== null) body.push("irradiance = vec3(0.0);");
  if (transfer !== null && distant) {
    const terms = range(used).map((i) => `${fromTexture ? `rgb${i}` : lane("transfer", i)} * light[${i}]`);
    body.push(`irradiance += transferScale * (${terms.join(" +\n    ")});`);
  }
  for (const slot of handOver) body.push(`passed${slot} = transferScale * transfer${slot};`);
  if (fieldHere !== null) {
    body.push("vec3 normalLight = normalize(toLight(worldNormal));");
    if (glossy) {
      body.push("vec3 mirrored = toLight(reflect(normalize(worldPosition - cameraPosition), normalize(worldNormal)));");
      body.push(basisValues("r", "mirrored", bandsHeld(variant)));
    }
    const matte = matteOf(variant, "normalLight", "transfer");
    body.push(fieldSums(variant, fieldHere, "toLight(worldPosition)", matte, glossy));
    body.push(`irradiance += ${transfer === null ? "" : "transferScale * "}fieldMatte;`);
    if (glossy) body.push("fieldShine = fieldGlossy;");
  }
  return [...head, "void main() {", `  ${body.filter((line) => line !== "").join("\n  ")}`, "}"].join("\n");
}

function fragmentText(variant: Variant): string {
  const { transfer, field, distant, glossy, coloured, mirror, bands } = variant;
  const fieldHere = field?.sampling === "fragment" ? field : null;
  const received = transfer !== null || field?.sampling === "vertex";
  const used = transfer === null ? 0 : Math.min(bands, transfer.bands) ** 2;
  const handOver = fieldHere === null ? [] : range(slotsOf(used));
  const reflects = glossy || mirror !== "none";
  const head: string[] = ["uniform vec3 albedo;", "varying vec3 worldPosition;", "varying vec3 worldNormal;"];
  const body: string[] = [];

  if (received) head.push("varying vec3 irradiance;");
  if (transfer !== null) head.push("varying float visibility;");
  if (coloured) head.push("varying vec3 own;");
  if (field?.sampling === "vertex" && glossy) head.push("varying vec3 fieldShine;");
  for (const slot of handOver) head.push(`varying vec4 passed${slot};`);
  if (glossy) head.push("uniform float gloss;");
  if (transfer === null && distant) {
    head.push(`uniform vec3 diffuse[${COUNT}];`, harmonics("diffuseAt", "diffuse", bands > FEW_BANDS ? PAGE_BANDS : 3));
  }
  if (glossy && distant) head.push(`uniform vec3 glossy[${COUNT}];`, harmonics("glossyAt", "glossy", PAGE_BANDS));
  if (fieldHere !== null) head.push(fieldHead(fieldHere, glossy));
  if (mirror !== "none") head.push("uniform float mirror;");
  if (mirror === "picture") head.push(PICTURED);
  if (mirror === "harmonics") head.push(`uniform vec3 surround[${COUNT}];`, harmonics("surroundAt", "surround", PAGE_BANDS));
  head.push(WITHOUT_NEGATIVES, toLight(variant.axes));

  body.push("vec3 n = normalize(worldNormal);", "vec3 received = vec3(0.0);");
  if (received) body.push("received += irradiance;");
  if (transfer === null && distant) body.push("received += diffuseAt(toLight(n));");
  if (reflects) body.push("vec3 reflected = reflect(normalize(worldPosition - cameraPosition), n);");
  if (fieldHere !== null) {
    body.push("vec3 normalLight = toLight(n);");
    if (glossy) {
      body.push("vec3 mirrored = toLight(reflected);", basisValues("r", "mirrored", bandsHeld(variant)));
    }
    const matte = matteOf(variant, "normalLight", "passed");
    body.push(fieldSums(variant, fieldHere, "toLight(worldPosition)", matte, glossy), "received += fieldMatte;");
  }
  body.push(`vec3 colour = ${coloured ? "albedo * own" : "albedo"} * withoutNegatives(received) / 3.14159265359;`);
  if (glossy) {
    const terms = [
      ...(distant ? ["glossyAt(toLight(reflected))"] : []),
      ...(fieldHere !== null ? ["fieldGlossy"] : field !== null ? ["fieldShine"] : []),
    ];
    const open = transfer === null ? "" : " * clamp(visibility, 0.0, 1.0)";
    body.push(`vec3 polished = withoutNegatives(${terms.join(" + ") || "vec3(0.0)"})${open};`);
    body.push("colour = mix(colour, polished, gloss);");
  }
  // Equation 15 of paper 003.
  if (mirror === "picture") body.push("colour += mirror * pictured(toLight(reflected));");
  if (mirror === "harmonics") body.push("colour += mirror * withoutNegatives(surroundAt(toLight(reflected)));");
  body.push(
    "gl_FragColor = vec4(colour, 1.0);",
    "#include <tonemapping_fragment>",
    "#include <colorspace_fragment>",
  );
  return [...head, "void main() {", `  ${body.filter((line) => line !== "").join("\n  ")}`, "}"].join("\n");
}
