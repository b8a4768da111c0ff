// Surfaces lit by spherical harmonics: a material picks the shader that its mesh and the light need.

import { Color, ShaderMaterial, Texture, Vector2, type DataTexture, type IUniform } from "three";

import { fieldUniforms, type Field } from "./grid/field.ts";
import { MOST_GROUPS } from "./grid/info.ts";
import { PAGE_BANDS, lambertFactors, phongFactors, scaleBands, withBands, type Vector3 as Triple } from "./sh.ts";
import { litShader, type FieldVariant, type TransferVariant, type Variant } from "./shader.ts";

const COUNT = PAGE_BANDS * PAGE_BANDS;
export const DARKNESS = new Float32Array(3 * COUNT);

/** The light of a moment, as it is to be drawn. */
export interface Illumination {
  /** Light that comes from afar to every place; `null`: none. */
  distant: Float32Array | null;
  /** Light that differs from place to place: grids that add up, each multiplied with a gain a channel. */
  fields: readonly { field: Field; gain: Triple }[];
  /** Whether their gradients are used, where they have any. */
  gradients: boolean;
  /** What is behind the objects, where no picture is. */
  surround: Float32Array;
}

export const DARK: Illumination = { distant: DARKNESS, fields: [], gradients: false, surround: DARKNESS };

/** Uniforms of the current light, premultiplied for each use. One object serves every material. */
export class LightUniforms {
  readonly light: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly diffuse: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly glossy: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly surround: { value: Float32Array } = { value: new Float32Array(3 * COUNT) };
  readonly lobe: { value: Float32Array } = { value: new Float32Array(PAGE_BANDS) };
  /** A set for each light group. */
  readonly fields: readonly Record<string, IUniform>[] = Array.from({ length: MOST_GROUPS }, fieldUniforms);
  readonly picture: Record<string, IUniform> = {
    picture: { value: new Texture() },
    pictureSize: { value: new Vector2(1, 1) },
    pictureK: { value: 1 },
    pictureCap: { value: 1 },
  };
  bands = PAGE_BANDS;
  distant = true;
  sampling: FieldVariant["sampling"] = "vertex";
  fieldVariant: FieldVariant | null = null;
  /** What a mirror shows. */
  behind: "picture" | "harmonics" = "harmonics";

  /** Take over new light; `bands` may cut off its fine detail. */
  set({ distant, fields, gradients, surround }: Illumination, bands: number, exponent: number): void {
    const light = withBands(withBands(distant ?? DARKNESS, bands), PAGE_BANDS);
    const factors = phongFactors(exponent, PAGE_BANDS);
    this.bands = bands;
    this.distant = distant !== null;
    this.light.value = light;
    this.diffuse.value = scaleBands(light, lambertFactors(PAGE_BANDS));
    this.glossy.value = scaleBands(light, factors);
    this.surround.value = withBands(withBands(surround, bands), PAGE_BANDS);
    this.lobe.value = Float32Array.from(factors);
    fields.forEach(({ field, gain }, k) => field.describe(this.fields[k]!, gain));
    const members = fields.map(({ field }) => field.variant(gradients));
    this.fieldVariant = members.length === 0 ? null : { sampling: this.sampling, members };
  }
}

/** The uniforms of each light group by their full names. */
function named(fields: LightUniforms["fields"]): Record<string, IUniform> {
  const entries = fields.flatMap((uniforms, k) => Object.entries(uniforms).map(([name, uniform]) => [`field${k}${name}`, uniform]));
  return Object.fromEntries(entries) as Record<string, IUniform>;
}

export interface Surface {
  /** Linear when set through `Color`; `#rrggbb` is sRGB. */
  albedo: Color;
  /** 0: matte, 1: a Phong lobe. */
  gloss: number;
  /** Weight of the mirrored backdrop. */
  mirror: number;
}

/** What a mesh brings along for its material. */
export interface MeshTraits {
  transfer: (TransferVariant & { scale: number; table?: DataTexture; perRow?: number }) | null;
  coloured: boolean;
}

/** A surface that mixes a matte part (`gloss` 0) and a Phong lobe (`gloss` 1), and may mirror its surroundings. */
export class LitMaterial extends ShaderMaterial {
  readonly surface: Surface = { albedo: new Color(), gloss: 0, mirror: 0 };
  private key = "";

  constructor(
    private readonly lightUniforms: LightUniforms,
    readonly traits: MeshTraits = { transfer: null, coloured: false },
    private readonly axes: Variant["axes"] = "lightwell",
  ) {
    super({
      uniforms: {
        light: lightUniforms.light,
        diffuse: lightUniforms.diffuse,
        glossy: lightUniforms.glossy,
        surround: lightUniforms.surround,
        lobe: lightUniforms.lobe,
        ...named(lightUniforms.fields),
        ...lightUniforms.picture,
        albedo: { value: null },
        gloss: { value: 0 },
        mirror: { value: 0 },
        transferScale: { value: traits.transfer?.scale ?? 1 },
        transferTable: { value: traits.transfer?.table ?? null },
        transferPerRow: { value: traits.transfer?.perRow ?? 1 },
      },
    });
    this.uniforms["albedo"]!.value = this.surface.albedo;
    this.refresh(true);
  }

  /** Take over the surface and the light; the shader is compiled anew only when its variant changes. */
  refresh(shadows: boolean): void {
    const { gloss, mirror } = this.surface;
    this.uniforms["gloss"]!.value = gloss;
    this.uniforms["mirror"]!.value = mirror;
    const { transfer, coloured } = this.traits;
    const variant: Variant = {
      bands: this.lightUniforms.bands,
      distant: this.lightUniforms.distant,
      field: this.lightUniforms.fieldVariant,
      transfer: shadows && transfer !== null ? { bands: transfer.bands, from: transfer.from } : null,
      glossy: gloss > 0,
      mirror: mirror > 0 ? this.lightUniforms.behind : "none",
      coloured,
      axes: this.axes,
    };
    const key = JSON.stringify(variant);
    if (key === this.key) return;
    this.key = key;
    Object.assign(this, litShader(variant));
    this.needsUpdate = true;
  }
}
