// Small dense matrices, as rows.

import type { Vector3 } from "../sh.ts";

export type Rows = number[][];

/** The inverse, by elimination with pivots; raises `RangeError` where there is none. */
export function inverse(matrix: readonly (readonly number[])[]): Rows {
  const size = matrix.length;
  const rows = matrix.map((row, i) => [...row, ...row.map((_, k) => (k === i ? 1 : 0))]);
  for (let column = 0; column < size; column++) {
    let pivot = column;
    for (let row = column + 1; row < size; row++) {
      if (Math.abs(rows[row]![column]!) > Math.abs(rows[pivot]![column]!)) pivot = row;
    }
    [rows[column], rows[pivot]] = [rows[pivot]!, rows[column]!];
    const own = rows[column]!;
    const head = own[column]!;
    if (head === 0) throw new RangeError("the matrix has no inverse");
    for (let k = 0; k < own.length; k++) own[k]! /= head;
    rows.forEach((row, i) => {
      const factor = row[column]!;
      if (i !== column && factor !== 0) own.forEach((value, k) => (row[k]! -= factor * value));
    });
  }
  return rows.map((row) => row.slice(size));
}

export function times(matrix: readonly (readonly number[])[], vector: readonly number[]): number[] {
  return matrix.map((row) => dot(row, vector));
}

export function dot(one: readonly number[], other: readonly number[]): number {
  return one.reduce((sum, value, k) => sum + value * other[k]!, 0);
}

export function minus(one: readonly number[], other: readonly number[]): number[] {
  return one.map((value, k) => value - other[k]!);
}

/** Principal axes of vectors about their origin, the longest first, and the root of their summed squares along each. */
export function principalAxes(vectors: readonly (readonly number[])[]): { axes: Vector3[]; lengths: Vector3 } {
  const a: Rows = [0, 1, 2].map((i) => [0, 1, 2].map((j) => vectors.reduce((sum, v) => sum + v[i]! * v[j]!, 0)));
  const v: Rows = [0, 1, 2].map((i) => [0, 1, 2].map((j) => (i === j ? 1 : 0)));
  // Jacobi's rotations; a dozen sweeps are far more than enough for three rows.
  for (let sweep = 0; sweep < 12; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]] as const) {
      if (Math.abs(a[p]![q]!) < 1e-300) continue;
      const angle = 0.5 * Math.atan2(2 * a[p]![q]!, a[q]![q]! - a[p]![p]!);
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (const m of [a, v]) for (const row of m) [row[p], row[q]] = [c * row[p]! - s * row[q]!, s * row[p]! + c * row[q]!];
      const [rp, rq] = [[...a[p]!], [...a[q]!]];
      for (let k = 0; k < 3; k++) {
        a[p]![k] = c * rp[k]! - s * rq[k]!;
        a[q]![k] = s * rp[k]! + c * rq[k]!;
      }
    }
  }
  const order = [0, 1, 2].sort((i, j) => a[j]![j]! - a[i]![i]!);
  return {
    axes: order.map((k) => v.map((row) => row[k]!) as unknown as Vector3),
    lengths: order.map((k) => Math.sqrt(Math.max(0, a[k]![k]!))) as unknown as Vector3,
  };
}
