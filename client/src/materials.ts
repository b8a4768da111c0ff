// Surfaces lit by spherical harmonics. Three compiles these shaders as GLSL ES 3.00.

import { Color, ShaderMaterial } from "three";

import { WITHOUT_NEGATIVES, harmonics, transferred } from "./glsl.ts";
import { PAGE_BANDS, lambertFactors, phongFactors, scaleBands, withBands } from "./sh.ts";

const COUNT = PAGE_BANDS * PAGE_BANDS;
/** Bands up to which nine coefficients make all of the irradiance: Lambert's factor of degree 3 is zero. */
const FEW_BANDS = 4;

const VERTEX = /* glsl */ `
uniform vec3 light[${COUNT}];
uniform float transferScale;
${transferred("transferredIrradiance", "light")}
varying vec3 worldPosition;
varying vec3 worldNormal;
varying vec3 irradiance;
varying float visibility;
void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  worldPosition = world.xyz;
  worldNormal = normal;
  irradiance = transferScale * transferredIrradiance();
  // Share of the cosine-weighted hemisphere that is open: t_00 against π Y_00.
  visibility = transferScale * transfer0.x / 0.886226925;
  gl_Position = projectionMatrix * viewMatrix * world;
}`;

const FRAGMENT = /* glsl */ `
uniform vec3 diffuse[${COUNT}];
uniform vec3 glossy[${COUNT}];
uniform vec3 albedo;
uniform float gloss;
varying vec3 worldPosition;
varying vec3 worldNormal;
varying vec3 irradiance;
varying float visibility;
#ifdef MANY_BANDS
${harmonics("diffuseAt", "diffuse", PAGE_BANDS)}
#else
${harmonics("diffuseAt", "diffuse", 3)}
#endif
${harmonics("glossyAt", "glossy", PAGE_BANDS)}
${WITHOUT_NEGATIVES}
void main() {
  vec3 n = normalize(worldNormal);
  #ifdef SHADOWS
    vec3 received = irradiance;
    float open = clamp(visibility, 0.0, 1.0);
  #else
    vec3 received = diffuseAt(n);
    float open = 1.0;
  #endif
  vec3 matte = albedo * withoutNegatives(received) / 3.14159265359;
  #ifdef GLOSSY
    vec3 reflected = reflect(normalize(worldPosition - cameraPosition), n);
    vec3 polished = withoutNegatives(glossyAt(reflected)) * open;
    gl_FragColor = vec4(mix(matte, polished, gloss), 1.0);
  #else
    gl_FragColor = vec4(matte, 1.0);
  #endif
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}`;

/** Coefficients of the current light, premultiplied for each use. One object serves every material. */
export class LightUniforms {
  readonly light: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly diffuse: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly glossy: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  private manyBands = true;

  /** Take over new light; `bands` may cut off its fine detail. */
  set(coefficients: Float32Array, bands: number, exponent: number): void {
    const light = withBands(withBands(coefficients, bands), PAGE_BANDS);
    this.manyBands = bands > FEW_BANDS;
    this.light.value = light;
    this.diffuse.value = scaleBands(light, lambertFactors(PAGE_BANDS));
    this.glossy.value = scaleBands(light, phongFactors(exponent, PAGE_BANDS));
  }

  /** Choose the shader's variant; it is compiled anew only when that changes. */
  apply(material: ShaderMaterial, shadows: boolean): void {
    const glossy = (material.uniforms["gloss"]!.value as number) > 0;
    for (const [name, wanted] of Object.entries({ SHADOWS: shadows, MANY_BANDS: this.manyBands, GLOSSY: glossy })) {
      if (name in material.defines === wanted) continue;
      if (wanted) material.defines[name] = 1;
      else delete material.defines[name];
      material.needsUpdate = true;
    }
  }
}

/** A surface that mixes a matte part (`gloss` 0) and a Phong lobe (`gloss` 1). */
export function litMaterial(light: LightUniforms, colour: string, gloss: number): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    defines: { SHADOWS: 1, MANY_BANDS: 1, GLOSSY: 1 },
    uniforms: {
      light: light.light,
      diffuse: light.diffuse,
      glossy: light.glossy,
      albedo: { value: new Color(colour) },
      gloss: { value: gloss },
      transferScale: { value: 1 },
    },
  });
}
