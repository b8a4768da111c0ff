// Least squares without negative parts, for the few gains of light groups: `lightwell.render.nonnegative`.

/** Weight of the gains' pull towards 1, of the trace of the Gram matrix: it decides only what the light does not. */
const PRIOR = 1e-9;
/** The same where all lamps are dark there. */
const DARKEST = 1e-30;

/** Solve `matrix x = right`, symmetric and positive definite, by Cholesky's decomposition. */
function solve(matrix: readonly number[][], right: readonly number[]): number[] {
  const n = right.length;
  const lower: number[][] = [];
  for (let i = 0; i < n; i++) {
    const row: number[] = [];
    for (let j = 0; j <= i; j++) {
      let value = matrix[i]![j]!;
      for (let k = 0; k < j; k++) value -= row[k]! * (lower[j] ?? row)[k]!;
      row.push(i === j ? Math.sqrt(value) : value / lower[j]![j]!);
    }
    lower.push(row);
  }
  const x = [...right];
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < i; k++) x[i]! -= lower[i]![k]! * x[k]!;
    x[i]! /= lower[i]![i]!;
  }
  for (let i = n - 1; i >= 0; i--) {
    for (let k = i + 1; k < n; k++) x[i]! -= lower[k]![i]! * x[k]!;
    x[i]! /= lower[i]![i]!;
  }
  return x;
}

/**
 * The gains `g ≥ 0` that minimise `‖Σ g_k column_k − target‖² + λ ‖g − 1‖²`, given the products of the columns with each
 * other (`gram`) and with the target (`across`). Exact: every set of gains that are not 0 is tried; there are few.
 */
export function nonnegativeGains(gram: readonly (readonly number[])[], across: readonly number[]): number[] {
  const count = across.length;
  const pull = Math.max(PRIOR * gram.reduce((sum, row, k) => sum + row[k]!, 0), DARKEST);
  const right = across.map((value) => value + pull);
  let best: number[] = Array(count).fill(0);
  let most = 0;
  for (let subset = 1; subset < 1 << count; subset++) {
    const used = across.flatMap((_, k) => ((subset >> k) & 1 ? [k] : []));
    const matrix = used.map((i) => used.map((j) => gram[i]![j]! + (i === j ? pull : 0)));
    const found = solve(matrix, used.map((k) => right[k]!));
    // At the solution of a subset the objective is a constant − g·r: the larger g·r, the better.
    const gained = found.reduce((sum, value, k) => sum + value * right[used[k]!]!, 0);
    if (!(gained > most) || found.some((value) => value < 0)) continue;
    most = gained;
    best = Array(count).fill(0);
    used.forEach((k, i) => (best[k] = found[i]!));
  }
  return best;
}
