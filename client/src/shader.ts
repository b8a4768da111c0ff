// The shaders of every lit surface. Each variant is text of its own, straight-line and without what it does not need:
// no branch, no dynamic index. Three compiles them as GLSL ES 3.00.

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

/** A field of coefficients in one 3D texture, see `grid/layout.ts`. */
export interface FieldVariant {
  /** Where it is looked up. */
  sampling: "vertex" | "fragment";
  /** Bands that the texture holds. */
  stored: number;
  /** Tiles beside each other in the atlas. */
  columns: number;
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

/** Coefficients that the matte part reads, as terms to be weighted; `null` where the weight is zero. */
function matteWeights(variant: Variant, normal: string, transfer: string): { lines: string; weights: (string | null)[] } {
  const bands = Math.min(variant.bands, variant.field?.stored ?? PAGE_BANDS);
  if (variant.transfer !== null) {
    const used = Math.min(bands, variant.transfer.bands) ** 2;
    return { lines: "", weights: range(COUNT).map((i) => (i < used ? lane(transfer, i) : null)) };
  }
  const needed = bands > FEW_BANDS ? bands : Math.min(bands, 3);
  const factors = lambertFactors(PAGE_BANDS);
  const weights = range(COUNT).map((i) => {
    const factor = factors[Math.floor(Math.sqrt(i))]!;
    return i < needed * needed && Math.abs(factor) > 1e-9 ? `${literal(factor)} * n${i}` : null;
  });
  return { lines: basisValues("n", normal, needed), weights };
}

/** Fetch the field's texels once, and sum them with the weights of the matte and the glossy part. */
function fieldSums(variant: Variant, field: FieldVariant, place: string, matte: (string | null)[], gloss: boolean): string {
  const bands = Math.min(variant.bands, field.stored);
  const used = bands * bands;
  const stored = field.stored * field.stored;
  const groups = stored >> 2;
  const shiny = (i: number) => (gloss && i < used ? `lobe[${Math.floor(Math.sqrt(i))}] * r${i}` : null);
  const fetch = (tile: number) => {
    const offset = `vec2(${literal(tile % field.columns)}, ${literal(Math.floor(tile / field.columns))})`;
    return `textureLod(field, vec3(place.xy + ${offset} * fieldStep, place.z), 0.0)`;
  };
  const lines = [`vec3 place = fieldPlace(${place});`, "vec3 fieldMatte = vec3(0.0), fieldGlossy = vec3(0.0);"];
  for (let group = 0; group < groups; group++) {
    const lanes = [0, 1, 2, 3].map((i) => 4 * group + i);
    const rows = [
      ["fieldMatte", lanes.map((i) => (i < used ? (matte[i] ?? null) : null))],
      ["fieldGlossy", lanes.map(shiny)],
    ] as const;
    if (rows.every(([, weights]) => weights.every((weight) => weight === null))) continue;
    for (const [k, colour] of ["R", "G", "B"].entries()) lines.push(`vec4 t${colour}${group} = ${fetch(3 * group + k)};`);
    for (const [sum, weights] of rows) {
      if (weights.every((weight) => weight === null)) continue;
      const vector = `vec4(${weights.map((weight) => weight ?? "0.0").join(", ")})`;
      lines.push(`vec4 ${sum}${group} = ${vector};`);
      lines.push(`${sum} += vec3(${["R", "G", "B"].map((c) => `dot(${sum}${group}, t${c}${group})`).join(", ")});`);
    }
  }
  if (stored % 4 === 1 && used === stored) {
    const last = stored - 1;
    if (matte[last] !== null || gloss) lines.push(`vec3 tLast = ${fetch(3 * groups)}.rgb;`);
    if (matte[last] !== null) lines.push(`fieldMatte += ${matte[last]} * tLast;`);
    if (gloss) lines.push(`fieldGlossy += ${shiny(last)} * tLast;`);
  }
  lines.push("fieldMatte *= fieldGain;", "fieldGlossy *= fieldGain;");
  return lines.join("\n  ");
}

const fieldUniforms = (gloss: boolean): string => /* glsl */ `
uniform highp sampler3D field;
uniform vec3 fieldLower;
uniform vec3 fieldPerMetre;
uniform vec3 fieldCells;
uniform vec3 fieldTexel;
uniform vec2 fieldStep;
uniform vec3 fieldGain;
${gloss ? `uniform float lobe[${PAGE_BANDS}];` : ""}
// Half a texel inside each tile, so that tiles do not bleed into each other.
vec3 fieldPlace(vec3 p) {
  return clamp((p - fieldLower) * fieldPerMetre, vec3(0.5), fieldCells - 0.5) * fieldTexel;
}`;

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

/** Three-coloured transfer against the field: the texels have to be turned from lanes to colours. */
function colouredFieldMatte(variant: Variant, field: FieldVariant): string {
  const used = Math.min(variant.bands, field.stored, variant.transfer!.bands) ** 2;
  const stored = field.stored * field.stored;
  const groups = stored >> 2;
  const lines: string[] = ["fieldMatte = vec3(0.0);"];
  for (let i = 0; i < used; i++) {
    const group = i >> 2;
    if (group === groups) {
      lines.push(`fieldMatte += rgb${i} * tLast;`);
    } else {
      const c = "xyzw"[i & 3]!;
      lines.push(`fieldMatte += rgb${i} * vec3(tR${group}.${c}, tG${group}.${c}, tB${group}.${c});`);
    }
  }
  lines.push("fieldMatte *= fieldGain;");
  return lines.join("\n  ");
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
  if (fieldHere !== null) head.push(fieldUniforms(glossy));
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
      body.push(basisValues("r", "mirrored", Math.min(variant.bands, fieldHere.stored)));
    }
    if (fromTexture) {
      // Every texel is fetched; the sums with scalar weights are replaced below.
      const all = range(COUNT).map((i) => (i < Math.min(used, fieldHere.stored ** 2) ? "1.0" : null));
      body.push(fieldSums(variant, fieldHere, "toLight(worldPosition)", all, glossy));
      body.push(colouredFieldMatte(variant, fieldHere));
    } else {
      const { lines, weights } = matteWeights(variant, "normalLight", "transfer");
      body.push(lines, fieldSums(variant, fieldHere, "toLight(worldPosition)", weights, glossy));
    }
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
  if (fieldHere !== null) head.push(fieldUniforms(glossy));
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
      body.push("vec3 mirrored = toLight(reflected);", basisValues("r", "mirrored", Math.min(bands, fieldHere.stored)));
    }
    const { lines, weights } = matteWeights(variant, "normalLight", "passed");
    body.push(lines, fieldSums(variant, fieldHere, "toLight(worldPosition)", weights, glossy), "received += fieldMatte;");
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
