// Spherical harmonics as in core/lightwell/conventions.py: real, orthonormal, no Condon–Shortley phase, coefficient
// (l, m) at index l² + l + m, world +Z as the polar axis. Numbers in brackets are sections of the maths specification.

export type Vector3 = readonly [number, number, number];

/** RGB coefficients, coefficient-major: R, G, B of coefficient 0 first; `3 · bands²` numbers. */
export type Coefficients = Float32Array | Float64Array;

/** Most bands that the page draws: 25 coefficients. */
export const PAGE_BANDS = 5;

/** Factors of the basis recurrence [§1]: `Q_lm = a (z Q_{l−1,m} − b Q_{l−2,m})`. */
export function recurrence(degree: number, order: number): { a: number; b: number } {
  const l2 = degree * degree;
  const m2 = order * order;
  const before = (degree - 1) * (degree - 1);
  return { a: Math.sqrt((4 * l2 - 1) / (l2 - m2)), b: Math.sqrt((before - m2) / (4 * before - 1)) };
}

/** `Q_mm` for every order below `bands`; √2 of the orders ≠ 0 is inside [§1]. */
export function diagonal(bands: number): number[] {
  const values = [1 / Math.sqrt(4 * Math.PI)];
  for (let m = 1; m < bands; m++) {
    values.push(values[m - 1]! * Math.sqrt(((2 * m + 1) / (2 * m)) * (m === 1 ? 2 : 1)));
  }
  return values;
}

/** The basis functions at a unit vector, `bands²` numbers. */
export function basis([x, y, z]: Vector3, bands: number): Float64Array {
  const values = new Float64Array(bands * bands);
  const start = diagonal(bands);
  let cosine = 1; // sinᵐθ cos mφ
  let sine = 0; // sinᵐθ sin mφ
  for (let m = 0; m < bands; m++) {
    let previous = 0;
    let current = start[m]!;
    for (let l = m; l < bands; l++) {
      if (l > m) {
        const { a, b } = recurrence(l, m);
        [previous, current] = [current, a * (z * current - b * previous)];
      }
      values[l * l + l + m] = current * cosine;
      if (m > 0) values[l * l + l - m] = current * sine;
    }
    [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
  }
  return values;
}

/** Lambert's factors `A_l` from radiance to irradiance [§8]: π, 2π/3, π/4, 0, −π/24, … */
export function lambertFactors(bands: number): number[] {
  return phongMoments(1, bands).map((moment) => 2 * Math.PI * moment);
}

/** Factors that blur radiance with the normalised Phong lobe `(s+1)/2π · max(0, cos)^s` [§8]. */
export function phongFactors(exponent: number, bands: number): number[] {
  return phongMoments(exponent, bands).map((moment) => (exponent + 1) * moment);
}

/** Moments `I_l = ∫₀¹ u^s P_l(u) du` for any real s ≥ 0 [§8]. */
export function phongMoments(exponent: number, bands: number): number[] {
  const moments = [1 / (exponent + 1), 1 / (exponent + 2)];
  for (let l = 2; l < bands; l++) moments.push((moments[l - 2]! * (exponent - l + 2)) / (exponent + l + 1));
  return moments.slice(0, bands);
}

/**
 * Relative L2 error of a Phong lobe that is cut off after `bands` bands [§8]: what the shader cannot show of it. The
 * lobe's energy is 2π/(2s+1), that of its degree l is π (2l+1) I_l².
 */
export function phongTruncation(exponent: number, bands: number): number {
  const kept = phongMoments(exponent, bands).reduce((sum, moment, l) => sum + (2 * l + 1) * moment * moment, 0);
  return Math.sqrt(Math.max(0, 1 - ((2 * exponent + 1) / 2) * kept));
}

/** Multiply every coefficient of degree l by `factors[l]`; degrees without a factor become 0. */
export function scaleBands(coefficients: Coefficients, factors: readonly number[]): Float32Array {
  const scaled = new Float32Array(coefficients.length);
  for (let i = 0; i < coefficients.length; i++) {
    scaled[i] = coefficients[i]! * (factors[Math.floor(Math.sqrt(Math.floor(i / 3)))] ?? 0);
  }
  return scaled;
}

/** Evaluate RGB coefficients in one direction. */
export function radiance(coefficients: Coefficients, direction: Vector3): [number, number, number] {
  const values = basis(direction, bandsOf(coefficients));
  const sum: [number, number, number] = [0, 0, 0];
  values.forEach((value, i) => {
    for (let channel = 0; channel < 3; channel++) sum[channel]! += value * coefficients[3 * i + channel]!;
  });
  return sum;
}

/** Irradiance on a surface with this unit normal. */
export function irradiance(coefficients: Coefficients, normal: Vector3): [number, number, number] {
  return radiance(scaleBands(coefficients, lambertFactors(bandsOf(coefficients))), normal);
}

/** Radiance blurred by the normalised Phong lobe around the reflected direction. */
export function phong(coefficients: Coefficients, reflected: Vector3, exponent: number): [number, number, number] {
  return radiance(scaleBands(coefficients, phongFactors(exponent, bandsOf(coefficients))), reflected);
}

/** How many bands the coefficients have; raises `RangeError` where they are no whole number of bands. */
export function bandsOf(coefficients: ArrayLike<number>): number {
  const bands = Math.sqrt(coefficients.length / 3);
  if (!Number.isInteger(bands) || bands < 1) {
    throw new RangeError(`${coefficients.length} numbers are no whole number of RGB bands (3, 12, 27, 48, 75, …)`);
  }
  return bands;
}

/** Read little-endian float32 coefficients as they come over the wire; raises as `bandsOf`. */
export function unpackCoefficients(bytes: Uint8Array): Float32Array {
  if (bytes.byteLength % 4 !== 0) throw new RangeError(`${bytes.byteLength} bytes are no whole number of float32`);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const coefficients = Float32Array.from({ length: bytes.byteLength / 4 }, (_, i) => view.getFloat32(4 * i, true));
  bandsOf(coefficients);
  return coefficients;
}

/** The first `bands` bands, filled up with zeros where there are fewer. */
export function withBands(coefficients: Float32Array, bands: number): Float32Array {
  const result = new Float32Array(3 * bands * bands);
  result.set(coefficients.subarray(0, result.length));
  return result;
}

/** Luminance of linear Rec. 709 RGB. */
export function luminance(red: number, green: number, blue: number): number {
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}

/** Luminance of the mean radiance over the sphere: `c₀₀ Y₀₀`. */
export function meanLuminance(coefficients: Coefficients): number {
  return luminance(coefficients[0]!, coefficients[1]!, coefficients[2]!) / Math.sqrt(4 * Math.PI);
}
