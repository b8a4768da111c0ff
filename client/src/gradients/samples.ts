// Light between samples that have gradients (MATHS §7.8): core/lightwell/gradients/interpolate.py in TypeScript.
// Within the samples' hull the weights have linear precision and half of each gradient is right; what lies off it is
// extrapolated by the whole gradient from the nearest point of the hull.

import type { Coefficients, Vector3 } from "../sh.ts";
import { addChange, addLimited } from "./extrapolate.ts";
import { dot, inverse, minus, principalAxes, times, type Rows } from "./matrix.ts";
import { barycentric, triangulate } from "./triangulation.ts";

/** Samples nearer to each other than this share of the set's extent (or than a micrometre) are one place. */
const SAME = 1e-6;
/** Samples that leave a line or plane by less than this share of the set's extent lie on it. */
const THIN = 1e-3;

export interface Sample {
  /** Metres. */
  position: Vector3;
  /** `(bands², 3)`. */
  coefficients: Coefficients;
  /** `(bands², 3, 3)` per metre; `null`: it has none. */
  gradients: Coefficients | null;
}

/** How much each sample counts at a point, and the step to multiply its gradient with. */
export interface Mix {
  weights: number[];
  steps: Vector3[];
}

/** Where points lie among samples: simplices of the samples' line, plane or space. */
export class Places {
  private readonly origin: Vector3;
  private readonly axes: Vector3[];
  private readonly local: Rows;
  private readonly simplices: { corners: number[]; toShares: Float64Array }[] = [];
  /** Facets, edges and corners of the hull, with what projects onto each. */
  private readonly hull: { corners: number[]; start: number[]; edges: Rows; toShares: Rows }[] = [];

  /** Raises `RangeError` where there is no sample, or two share a place. */
  constructor(readonly positions: readonly Vector3[]) {
    if (positions.length === 0) throw new RangeError("there is no sample");
    this.origin = [0, 1, 2].map((k) => positions.reduce((sum, place) => sum + place[k]!, 0) / positions.length) as unknown as Vector3;
    const spread = positions.map((place) => minus(place, this.origin));
    const extent = Math.max(...spread.flat().map(Math.abs));
    positions.forEach((one, i) => {
      if (positions.slice(0, i).some((other) => Math.hypot(...minus(one, other)) <= Math.max(SAME * extent, 1e-6))) {
        throw new RangeError("two samples share a place");
      }
    });
    const { axes, lengths } = principalAxes(spread);
    this.axes = positions.length === 1 ? [] : axes.filter((_, k) => lengths[k]! > THIN * lengths[0]);
    this.local = spread.map((place) => times(this.axes, place));
    if (this.axes.length === 0) return;
    const { simplices, hull } = triangulate(this.local);
    this.simplices = simplices.map((corners) => ({
      corners,
      toShares: Float64Array.from(barycentric(corners.map((k) => [...this.local[k]!, 1])).flat()),
    }));
    this.hull = this.facesOf(hull);
  }

  /** Barycentric weights of the samples at the point of their hull that is nearest to `point`. */
  locate(point: Vector3): number[] {
    if (this.axes.length === 0) return [1];
    const local = times(this.axes, minus(point, this.origin));
    const { corners, shares } = this.inSimplex(local) ?? this.nearestOnHull(local);
    const positive = shares.map((share) => Math.max(share, 0));
    const total = positive.reduce((sum, share) => sum + share, 0);
    const weights = this.positions.map(() => 0);
    corners.forEach((corner, k) => (weights[corner] = positive[k]! / total));
    return weights;
  }

  /** The simplex that a point is in; `null`: none. */
  private inSimplex(local: readonly number[]): { corners: number[]; shares: number[] } | null {
    const size = local.length + 1;
    const share = (matrix: Float64Array, row: number) => {
      let sum = matrix[row * size + local.length]!;
      for (let k = 0; k < local.length; k++) sum += matrix[row * size + k]! * local[k]!;
      return sum;
    };
    let best = this.simplices[0]!;
    let highest = -Infinity;
    for (const simplex of this.simplices) {
      let lowest = Infinity;
      // What is already lower than the best need not be known.
      for (let row = 0; row < size && lowest > highest; row++) lowest = Math.min(lowest, share(simplex.toShares, row));
      if (lowest > highest) [best, highest] = [simplex, lowest];
    }
    if (highest < -1e-9) return null;
    return { corners: best.corners, shares: best.corners.map((_, row) => share(best.toShares, row)) };
  }

  /** At a point: weights of linear precision, and each sample's step. */
  mix(point: Vector3): Mix {
    const weights = this.locate(point);
    const nearest = [0, 1, 2].map((k) => this.positions.reduce((sum, place, i) => sum + weights[i]! * place[k]!, 0));
    // Across a thin set the hull is its line or plane.
    const onHull = this.axes.length === 0 ? this.origin : this.flattened(nearest);
    const steps = this.positions.map(
      (place) => place.map((from, k) => point[k]! - from - 0.5 * (onHull[k]! - from)) as unknown as Vector3,
    );
    return { weights, steps };
  }

  private flattened(place: readonly number[]): number[] {
    const local = times(this.axes, minus(place, this.origin));
    return this.origin.map((from, k) => from + this.axes.reduce((sum, axis, i) => sum + local[i]! * axis[k]!, 0));
  }

  private facesOf(facets: number[][]): Places["hull"] {
    const faces = new Map<string, number[]>();
    for (const facet of facets) {
      for (let subset = 1; subset < 1 << facet.length; subset++) {
        const corners = facet.filter((_, k) => ((subset >> k) & 1) === 1);
        faces.set(corners.join(), corners);
      }
    }
    return [...faces.values()].map((corners) => {
      const [start, ...others] = corners.map((k) => this.local[k]!) as [number[], ...number[][]];
      const edges = others.map((corner) => minus(corner, start));
      const gram = edges.map((one) => edges.map((other) => dot(one, other)));
      const toShares = edges.length === 0 ? [] : inverse(gram).map((row) => start.map((_, k) => row.reduce((sum, value, i) => sum + value * edges[i]![k]!, 0)));
      return { corners, start, edges, toShares };
    });
  }

  /** The facet of the hull, or the edge or corner of one, that is nearest: that on which the foot is and is nearest. */
  private nearestOnHull(local: readonly number[]): { corners: number[]; shares: number[] } {
    let best = { distance: Infinity, corners: [] as number[], shares: [] as number[] };
    for (const { corners, start, edges, toShares } of this.hull) {
      const toPoint = minus(local, start);
      const rest = times(toShares, toPoint);
      const first = rest.reduce((left, share) => left - share, 1);
      if (first < -1e-12 || rest.some((share) => share < -1e-12)) continue;
      const distance = toPoint.reduce((sum, value, k) => sum + (value - rest.reduce((at, share, i) => at + share * edges[i]![k]!, 0)) ** 2, 0);
      if (distance < best.distance) best = { distance, corners, shares: [first, ...rest] };
    }
    return best;
  }
}

/** Samples of light at a few places, and the light between and near them. */
export class SampleSet {
  /** Whether any sample has a gradient. */
  readonly gradients: boolean;
  private readonly change: Float64Array;

  /** `places`: of an earlier set with the same positions. Raises as `Places`. */
  constructor(
    readonly samples: readonly Sample[],
    readonly places = new Places(samples.map(({ position }) => position)),
  ) {
    this.change = new Float64Array(samples[0]!.coefficients.length);
    this.gradients = samples.some(({ gradients }) => gradients !== null);
  }

  at(point: Vector3): Float64Array {
    return this.mixed(this.places.mix(point));
  }

  /**
   * The coefficients `Σ W_k (c_k + G_k·step_k)`, with the step's limit; into `values` where they are given. Between a
   * sample with a gradient and one without the light bends by how the gradient departs from the chord.
   */
  mixed({ weights, steps }: Mix, values = new Float64Array(this.samples[0]!.coefficients.length)): Float64Array {
    values.fill(0);
    const change = this.change.fill(0);
    const lacking = weights.map((weight, k) => (this.samples[k]!.gradients === null ? weight : 0));
    const share = lacking.reduce((sum, weight) => sum + weight, 0);
    this.samples.forEach(({ position, coefficients, gradients }, k) => {
      const weight = weights[k]!;
      if (weight === 0) return;
      for (let i = 0; i < values.length; i++) values[i]! += weight * coefficients[i]!;
      if (!this.gradients) return;
      if (share > 0) {
        const straightened = weight * (gradients === null ? share - 1 : share);
        for (let i = 0; i < values.length; i++) change[i]! += straightened * coefficients[i]!;
      }
      if (gradients === null) return;
      const step = share === 0 ? steps[k]! : this.longer(steps[k]!, position, lacking);
      addChange(change, gradients, step, weight);
    });
    if (this.gradients) addLimited(values, change);
    return values;
  }

  /** A sample's step towards those that lack a gradient is whole, not half. */
  private longer(step: Vector3, from: Vector3, lacking: readonly number[]): Vector3 {
    const towards = (k: number) => lacking.reduce((sum, weight, i) => sum + weight * (this.samples[i]!.position[k]! - from[k]!), 0);
    return step.map((value, k) => value + 0.5 * towards(k)) as unknown as Vector3;
  }
}
