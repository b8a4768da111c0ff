// Delaunay simplices of a few points in one to three dimensions: core/lightwell/gradients/triangulation.py in TypeScript.
// They are the lower hull of the points lifted by their squared length. The first is found by the simplex method, the
// others by gift wrapping over its facets. A tiny lift of each point's own gives points on a common sphere one answer.

import { dot, inverse, minus, times, type Rows } from "./matrix.ts";

/** Distances from a facet, in units of the points' extent, that count as none. */
const FLAT = 1e-7;
/** Largest lift, in units of the extent squared. */
const LIFT = 1e-6;

export interface Triangulation {
  /** Numbers of d + 1 points each. */
  simplices: number[][];
  /** Facets that belong to one simplex only: numbers of d points each. */
  hull: number[][];
}

/** The simplices of points that span all their d dimensions; raises `RangeError` where they do not. */
export function triangulate(points: readonly (readonly number[])[]): Triangulation {
  const dimension = points[0]?.length ?? 0;
  const axes = Array.from({ length: dimension }, (_, k) => points.map((point) => point[k]!));
  const extent = Math.max(0, ...axes.map((values) => Math.max(...values) - Math.min(...values)));
  if (points.length <= dimension || extent === 0) throw new RangeError(`${points.length} points do not span ${dimension} dimensions`);
  const means = axes.map((values) => values.reduce((sum, value) => sum + value, 0) / values.length);
  const places = points.map((point) => minus(point, means).map((value) => value / extent));
  const heights = places.map((place, i) => dot(place, place) + LIFT * (((i + 1) ** 2 * 0.6180339887498949) % 1));
  const lifted = places.map((place) => [...place, 1]);
  const simplices = new Map<string, number[]>();
  const uses = new Map<string, { facet: number[]; count: number }>();
  const todo = [firstSimplex(lifted, heights)];
  for (let simplex = todo.pop(); simplex !== undefined; simplex = todo.pop()) {
    if (simplices.has(simplex.join())) continue;
    simplices.set(simplex.join(), simplex);
    const corners = nextCorners(lifted, heights, simplex);
    simplex.forEach((apex, k) => {
      const facet = simplex!.filter((corner) => corner !== apex);
      const use = uses.get(facet.join()) ?? { facet, count: 0 };
      uses.set(facet.join(), { facet, count: use.count + 1 });
      if (corners[k]! >= 0) todo.push([...facet, corners[k]!].sort((a, b) => a - b));
    });
  }
  const hull = [...uses.values()].filter(({ count }) => count === 1).map(({ facet }) => facet);
  return { simplices: [...simplices.values()], hull };
}

/** The columns are the corners' lifted points: its inverse gives barycentric coordinates. */
export function barycentric(corners: Rows): Rows {
  return inverse(corners[0]!.map((_, k) => corners.map((corner) => corner[k]!)));
}

/** For each corner the point that makes a simplex with the facet across it, by the least turn; −1 beyond the hull. */
function nextCorners(lifted: Rows, heights: number[], simplex: number[]): number[] {
  const toShares = barycentric(simplex.map((k) => lifted[k]!));
  const own = simplex.map((k) => heights[k]!);
  const altitudes = toShares.map((row) => 1 / Math.hypot(...row.slice(0, -1)));
  const best = simplex.map(() => ({ turn: Infinity, point: -1 }));
  lifted.forEach((point, i) => {
    const shares = times(toShares, point);
    const rise = heights[i]! - dot(shares, own);
    shares.forEach((share, k) => {
      if (-share <= FLAT / altitudes[k]!) return;
      const turn = rise / -share;
      if (turn < best[k]!.turn) best[k] = { turn, point: i };
    });
  });
  return best.map(({ point }) => point);
}

/** The simplex round a point, by the simplex method: the lowest lifted height over all convex sums. */
function firstSimplex(lifted: Rows, heights: number[]): number[] {
  const corners = spread(lifted.map((point) => point.slice(0, -1)));
  // No two shares alike: no facet passes through the point.
  const shares = corners.map((_, i) => 1 + 1e-3 * (i + 1));
  const total = shares.reduce((sum, share) => sum + share, 0);
  const aim = lifted[0]!.map((_, k) => corners.reduce((sum, corner, i) => sum + (shares[i]! / total) * lifted[corner]![k]!, 0));
  for (;;) {
    const toShares = barycentric(corners.map((k) => lifted[k]!));
    const weights = times(toShares, aim);
    const own = corners.map((k) => heights[k]!);
    const below = lifted.map((point, i) => (corners.includes(i) ? 0 : heights[i]! - dot(times(toShares, point), own)));
    const enters = below.indexOf(Math.min(...below));
    if (below[enters]! > -1e-12) return [...corners].sort((a, b) => a - b);
    const moves = times(toShares, lifted[enters]!);
    const ratios = moves.map((move, k) => (move > 1e-12 ? weights[k]! / move : Infinity));
    corners[ratios.indexOf(Math.min(...ratios))] = enters;
  }
}

/** d + 1 points far apart that span all d dimensions. */
function spread(places: Rows): number[] {
  const corners = [0];
  let rest = places.map((place) => minus(place, places[0]!));
  for (let k = 0; k < places[0]!.length; k++) {
    const squares = rest.map((row) => dot(row, row));
    const far = squares.indexOf(Math.max(...squares));
    const length = Math.sqrt(squares[far]!);
    if (length < FLAT) throw new RangeError(`the points do not span ${places[0]!.length} dimensions`);
    const axis = rest[far]!.map((value) => value / length);
    corners.push(far);
    rest = rest.map((row) => {
      const along = dot(row, axis);
      return row.map((value, i) => value - along * axis[i]!);
    });
  }
  return corners;
}
