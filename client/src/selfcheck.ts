// Does the graphics processor compute the same harmonics as `sh.ts`? Directions are handed over as data, because sine
// and cosine of a shader may be coarse.

import { harmonics } from "./glsl.ts";
import { PAGE_BANDS, lambertFactors, phongFactors, radiance, scaleBands, type Vector3 } from "./sh.ts";

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

function compile(gl: WebGL2RenderingContext, fragment: string): WebGLProgram {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]] as const) {
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
  const passed = results.every(({ error }) => error < TOLERANCE);
  const lines = results.map(({ name, error }) => `${name}: ${error.toExponential(1)}`);
  return { passed, text: [passed ? "They agree. Largest relative difference:" : "They do NOT agree.", ...lines].join("\n") };
}

const output = document.getElementById("result")!;
const { passed, text } = run();
output.style.whiteSpace = "pre-line";
output.dataset["passed"] = String(passed);
output.textContent = text;
