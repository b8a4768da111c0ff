// The surroundings behind the objects: the stream's picture, or the light as the harmonics hold it. Both are much coarser
// than the screen, so they are drawn into a small target when they change, and only enlarged with each picture.

import {
  BufferAttribute,
  BufferGeometry,
  HalfFloatType,
  LinearFilter,
  Mesh,
  NoColorSpace,
  RepeatWrapping,
  Scene,
  ShaderMaterial,
  Texture,
  Vector2,
  WebGLRenderTarget,
  type PerspectiveCamera,
  type WebGLRenderer,
} from "three";

import { PICTURED, WITHOUT_NEGATIVES, harmonics } from "./glsl.ts";
import type { LightUniforms } from "./materials.ts";
import { PAGE_BANDS } from "./sh.ts";
import type { Backdrop } from "./wire.ts";

/** Screen pixels to a pixel of the small target. */
const REDUCTION = 4;

const VERTEX = /* glsl */ `
uniform mat4 worldFromCamera;
uniform mat4 cameraFromClip;
varying vec3 direction;
void main() {
  vec4 far = cameraFromClip * vec4(position.xy, 1.0, 1.0);
  direction = mat3(worldFromCamera) * (far.xyz / far.w);
  gl_Position = vec4(position.xy, 1.0, 1.0);
}`;

const FRAGMENT = /* glsl */ `
varying vec3 direction;
#ifdef PICTURE
${PICTURED}
  vec3 radianceFrom(vec3 d) { return pictured(d); }
#else
  uniform vec3 surround[${PAGE_BANDS * PAGE_BANDS}];
  ${harmonics("lightAt", "surround", PAGE_BANDS)}
  ${WITHOUT_NEGATIVES}
  vec3 radianceFrom(vec3 d) { return withoutNegatives(lightAt(d)); }
#endif
void main() {
  gl_FragColor = vec4(radianceFrom(normalize(direction)), 1.0);
}`;

const ENLARGE_VERTEX = /* glsl */ `
varying vec2 place;
void main() {
  place = 0.5 * position.xy + 0.5;
  gl_Position = vec4(position.xy, 1.0, 1.0);
}`;

const ENLARGE_FRAGMENT = /* glsl */ `
uniform sampler2D reduced;
varying vec2 place;
void main() {
  gl_FragColor = vec4(texture2D(reduced, place).rgb, 1.0);
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}`;

function isSamePicture(a: Backdrop, b: Backdrop): boolean {
  const alike = a.k === b.k && a.cap === b.cap && a.jpeg.length === b.jpeg.length;
  return alike && a.jpeg.every((byte, k) => byte === b.jpeg[k]);
}

export class Surroundings {
  /** What goes behind the objects. */
  readonly mesh: Mesh;
  private readonly material: ShaderMaterial;
  private readonly scene = new Scene();
  private readonly target = new WebGLRenderTarget(1, 1, { type: HalfFloatType, depthBuffer: false });
  private stale = true;
  private readonly texture = new Texture();
  private next: Backdrop | null = null;
  /** The last that was offered. */
  private newest: Backdrop | null = null;
  private decoding = false;
  private hasPicture = false;
  private wantsPicture = true;
  /** Counts `clear`: a picture that was being decoded meanwhile belongs to the past. */
  private era = 0;
  private decoded: { bitmap: ImageBitmap; message: Backdrop } | null = null;

  constructor(
    private readonly camera: PerspectiveCamera,
    light: LightUniforms,
  ) {
    light.picture["picture"]!.value = this.texture;
    this.texture.colorSpace = NoColorSpace;
    this.texture.wrapS = RepeatWrapping;
    this.texture.minFilter = this.texture.magFilter = LinearFilter;
    this.texture.generateMipmaps = false;
    this.texture.flipY = false;
    const triangle = new BufferGeometry();
    triangle.setAttribute("position", new BufferAttribute(Float32Array.of(-1, -1, 0, 3, -1, 0, -1, 3, 0), 3));
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      depthTest: false,
      depthWrite: false,
      uniforms: {
        worldFromCamera: { value: camera.matrixWorld },
        cameraFromClip: { value: camera.projectionMatrixInverse },
        surround: light.surround,
        ...light.picture,
      },
    });
    const enlarge = new ShaderMaterial({
      vertexShader: ENLARGE_VERTEX,
      fragmentShader: ENLARGE_FRAGMENT,
      depthTest: false,
      depthWrite: false,
      uniforms: { reduced: { value: this.target.texture } },
    });
    this.mesh = new Mesh(triangle, enlarge);
    this.mesh.renderOrder = -1;
    const source = new Mesh(triangle, this.material);
    this.mesh.frustumCulled = source.frustumCulled = false;
    this.scene.add(source);
  }

  /** The camera, the size or the light is another one now. */
  invalidate(): void {
    this.stale = true;
  }

  /** What is shown, and what a mirror reflects. */
  get source(): "picture" | "harmonics" {
    return "PICTURE" in this.material.defines ? "picture" : "harmonics";
  }

  /** Draw the small target anew where that is needed. */
  prepare(renderer: WebGLRenderer): void {
    if (!this.stale || !this.mesh.visible) return;
    this.stale = false;
    const size = renderer.getDrawingBufferSize(new Vector2()).divideScalar(REDUCTION).ceil();
    this.target.setSize(size.x, size.y);
    renderer.setRenderTarget(this.target);
    renderer.render(this.scene, this.camera);
    renderer.setRenderTarget(null);
  }

  /** Decode a picture beside the drawing; while one is being decoded only the newest waits. The same one stays. */
  offer(message: Backdrop): void {
    if (this.newest !== null && isSamePicture(message, this.newest)) return;
    this.newest = message;
    this.next = message;
    if (!this.decoding) void this.decode();
  }

  /** Forget the picture, so that another stream's is not shown. */
  clear(): void {
    this.era++;
    this.next = this.newest = null;
    this.decoded?.bitmap.close();
    this.decoded = null;
    this.hasPicture = false;
    this.chooseVariant();
  }

  /** Put a freshly decoded picture onto the texture; says whether there was one. */
  update(): boolean {
    if (this.decoded === null) return false;
    const { bitmap, message } = this.decoded;
    this.decoded = null;
    const { uniforms } = this.material;
    const size = uniforms["pictureSize"]!.value as Vector2;
    const previous = this.texture.image as ImageBitmap | null | undefined;
    // A texture's storage keeps its size.
    if (size.x !== bitmap.width || size.y !== bitmap.height) this.texture.dispose();
    size.set(bitmap.width, bitmap.height);
    uniforms["pictureK"]!.value = message.k;
    uniforms["pictureCap"]!.value = message.cap;
    this.texture.image = bitmap;
    this.texture.needsUpdate = true;
    previous?.close();
    this.hasPicture = true;
    this.stale = true;
    this.chooseVariant();
    return true;
  }

  /** Show the picture where there is one, else the harmonics. */
  preferPicture(wanted: boolean): void {
    this.wantsPicture = wanted;
    this.chooseVariant();
  }

  private chooseVariant(): void {
    const { material } = this;
    const picture = this.wantsPicture && this.hasPicture;
    if ("PICTURE" in material.defines === picture) return;
    if (picture) material.defines["PICTURE"] = 1;
    else delete material.defines["PICTURE"];
    material.needsUpdate = true;
    this.stale = true;
  }

  private async decode(): Promise<void> {
    this.decoding = true;
    while (this.next !== null) {
      const message = this.next;
      const era = this.era;
      this.next = null;
      const blob = new Blob([message.jpeg as Uint8Array<ArrayBuffer>], { type: "image/jpeg" });
      try {
        const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
        if (era !== this.era) {
          bitmap.close();
          continue;
        }
        this.decoded?.bitmap.close();
        this.decoded = { bitmap, message };
      } catch {
        // A picture that cannot be decoded is left out; the next one comes soon.
      }
    }
    this.decoding = false;
  }
}
