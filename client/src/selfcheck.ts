// Does the graphics processor compute the same harmonics as `sh.ts`? Directions are handed over as data, because sine
// and cosine of a shader may be coarse.

import { harmonics } from "./glsl.ts";
import { MOST_ATTRIBUTES, MOST_TEXTURES, litShader, type FieldVariant, type MemberVariant, type TransferVariant, type Variant } from "./shader.ts";
import { PAGE_BANDS, lambertFactors, phongFactors, radiance, scaleBands, type Vector3 } from "./sh.ts";

/** Prefixes that three.js puts before the shaders of `shader.ts`, as far as they are used there. */
const PREFIXES = {
  vertex: `#version 300 es
#define attribute in
#define varying out
precision highp float;
precision highp int;
precision highp sampler3D;
uniform mat4 modelMatrix, modelViewMatrix, projectionMatrix, viewMatrix;
uniform mat3 normalMatrix;
uniform vec3 cameraPosition;
in vec3 position;
in vec3 normal;
`,
  fragment: `#version 300 es
#define varying in
#define texture2D texture
#define gl_FragColor pixel
precision highp float;
precision highp int;
precision highp sampler3D;
uniform vec3 cameraPosition;
layout(location = 0) out vec4 pixel;
`,
};

const WIDTH = 64;
const HEIGHT = 32;
const TOLERANCE = 1e-5;

const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(float(gl_VertexID == 1) * 4.0 - 1.0, float(gl_VertexID == 2) * 4.0 - 1.0, 0.0, 1.0);
}`;

interface Check {
  name: string;
  bands: number;
  coefficients: Float32Array;
}

/** Lat-long pixel centres and both poles. */
function directions(): Vector3[] {
  const list = Array.from({ length: WIDTH * HEIGHT }, (_, i): Vector3 => {
    const theta = (Math.PI * (Math.floor(i / WIDTH) + 0.5)) / HEIGHT;
    const phi = (2 * Math.PI * ((i % WIDTH) + 0.5)) / WIDTH;
    return [Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta)];
  });
  list[0] = [0, 0, 1];
  list[list.length - 1] = [0, 0, -1];
  return list;
}

/** Coefficients of no particular light, the same each time. */
function someCoefficients(bands: number): Float32Array {
  return Float32Array.from({ length: 3 * bands * bands }, (_, i) => Math.sin(12.9898 * (i + 1)) * 2);
}

function checks(): Check[] {
  const list: Check[] = [];
  for (let bands = 1; bands <= PAGE_BANDS; bands++) {
    list.push({ name: `radiance, ${bands} bands`, bands, coefficients: someCoefficients(bands) });
  }
  const all = someCoefficients(PAGE_BANDS);
  list.push({ name: "irradiance", bands: PAGE_BANDS, coefficients: scaleBands(all, lambertFactors(PAGE_BANDS)) });
  list.push({ name: "Phong lobe", bands: PAGE_BANDS, coefficients: scaleBands(all, phongFactors(12, PAGE_BANDS)) });
  return list;
}

function compile(gl: WebGL2RenderingContext, fragment: string, vertex = VERTEX): WebGLProgram {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "program");
  return program;
}

function floatTexture(gl: WebGL2RenderingContext, data: Float32Array | null): WebGLTexture {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, WIDTH, HEIGHT, 0, gl.RGBA, gl.FLOAT, data);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return texture;
}

/** The largest difference between shader and processor, relative to the largest value. */
function difference(gl: WebGL2RenderingContext, { bands, coefficients }: Check, all: readonly Vector3[]): number {
  const program = compile(
    gl,
    `#version 300 es
    precision highp float;
    uniform highp sampler2D directions;
    uniform vec3 coefficients[${bands * bands}];
    out vec4 colour;
    ${harmonics("evaluate", "coefficients", bands)}
    void main() { colour = vec4(evaluate(texelFetch(directions, ivec2(gl_FragCoord.xy), 0).xyz), 1.0); }`,
  );
  gl.useProgram(program);
  gl.uniform3fv(gl.getUniformLocation(program, "coefficients"), coefficients);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = new Float32Array(4 * WIDTH * HEIGHT);
  gl.readPixels(0, 0, WIDTH, HEIGHT, gl.RGBA, gl.FLOAT, pixels);
  let largest = 0;
  let error = 0;
  all.forEach((direction, i) => {
    radiance(coefficients, direction).forEach((value, channel) => {
      largest = Math.max(largest, Math.abs(value));
      error = Math.max(error, Math.abs(value - pixels[4 * i + channel]!));
    });
  });
  return error / largest;
}

/** Variants among which every shader feature meets every other. */
function variants(): Variant[] {
  const list: Variant[] = [];
  const transfers: (TransferVariant | null)[] = [null, { bands: 5, from: "attributes" }, { bands: 5, from: "texture" }];
  const plain: MemberVariant = { form: "cells", stored: 5, columns: 5, bendColumns: null };
  const bent: MemberVariant = { ...plain, bendColumns: 8 };
  const bricks: MemberVariant = { ...plain, form: "bricks" };
  const few: MemberVariant = { ...plain, stored: 3, columns: 3 };
  const one: MemberVariant = { ...plain, stored: 1, columns: 1 };
  const fields: (FieldVariant | null)[] = [
    null,
    { sampling: "vertex", members: [plain] },
    { sampling: "fragment", members: [plain] },
    { sampling: "fragment", members: [few] },
    { sampling: "vertex", members: [one] },
    { sampling: "vertex", members: [bent] },
    { sampling: "fragment", members: [bricks] },
    { sampling: "fragment", members: [few, bricks, few, { ...few, bendColumns: 5 }] },
  ];
  for (const transfer of transfers) {
    for (const field of fields) {
      // Large shaders take long to compile: of what does not depend on the form of grids, the most is enough.
      const isPlain = field?.members.every(({ form, bendColumns }) => form === "cells" && bendColumns === null) ?? true;
      for (const glossy of isPlain ? [false, true] : [true]) {
        for (const mirror of isPlain ? (["none", "picture", "harmonics"] as const) : (["picture"] as const)) {
          const distant = field === null || mirror === "picture";
          list.push({ bands: 5, distant, field, transfer, glossy, mirror, coloured: glossy, axes: "lightwell" });
        }
      }
    }
  }
  return list;
}

/** Compile them all, and see how many attributes and texture units they take. Raises `Error` where one does not. */
function shaders(gl: WebGL2RenderingContext): string {
  const samplers = new Set<number>([gl.SAMPLER_2D, gl.SAMPLER_3D, gl.UNSIGNED_INT_SAMPLER_3D]);
  let attributes = 0;
  let textures = 0;
  const all = variants();
  for (const variant of all) {
    const { vertexShader, fragmentShader } = litShader(variant);
    const fragment = PREFIXES.fragment + fragmentShader.replaceAll(/^\s*#include.*$/gm, "");
    const program = compile(gl, fragment, PREFIXES.vertex + vertexShader);
    attributes = Math.max(attributes, gl.getProgramParameter(program, gl.ACTIVE_ATTRIBUTES) as number);
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) as number;
    const types = Array.from({ length: count }, (_, i) => gl.getActiveUniform(program, i)!.type);
    textures = Math.max(textures, types.filter((type) => samplers.has(type)).length);
    gl.deleteProgram(program);
  }
  if (attributes > MOST_ATTRIBUTES || textures > MOST_TEXTURES) {
    throw new Error(`Shaders take ${attributes} attributes and ${textures} textures; ${MOST_ATTRIBUTES} and ${MOST_TEXTURES} are there.`);
  }
  return `${all.length} shaders compile; they take at most ${attributes} attributes and ${textures} texture units`;
}

function run(): { passed: boolean; text: string } {
  const gl = new OffscreenCanvas(WIDTH, HEIGHT).getContext("webgl2");
  if (gl === null) return { passed: false, text: "This browser offers no WebGL 2." };
  if (gl.getExtension("EXT_color_buffer_float") === null) {
    return { passed: false, text: "This machine's graphics cannot draw into floating-point textures." };
  }
  const all = directions();
  gl.viewport(0, 0, WIDTH, HEIGHT);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, floatTexture(gl, null), 0);
  floatTexture(gl, Float32Array.from(all.flatMap((direction) => [...direction, 0])));
  const results = checks().map((check) => ({ name: check.name, error: difference(gl, check, all) }));
  let compiled = "";
  try {
    compiled = shaders(gl);
  } catch (error) {
    return { passed: false, text: `A shader does not compile: ${(error as Error).message}` };
  }
  const passed = results.every(({ error }) => error < TOLERANCE);
  const lines = results.map(({ name, error }) => `${name}: ${error.toExponential(1)}`);
  return { passed, text: [passed ? "They agree. Largest relative difference:" : "They do NOT agree.", ...lines, compiled].join("\n") };
}

const output = document.getElementById("result")!;
const { passed, text } = run();
output.style.whiteSpace = "pre-line";
output.dataset["passed"] = String(passed);
output.textContent = text;
