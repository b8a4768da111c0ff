// A static field modulated by a live probe (MATHS §11d): what the probe sees now against what the field holds at the
// probe's place says how the light has changed everywhere. `lightwell.render.light` is the same in Python.

import { lambertFactors, type Coefficients, type Vector3 } from "../sh.ts";
import { nonnegativeGains } from "./nonnegative.ts";

export type Method = "gain" | "groups";

export interface Modulation {
  /** What each grid is multiplied with, a channel. */
  gains: Vector3[];
  /** `gain`: one gain for the whole field (method 2); `groups`: one for each light group (method 4). */
  method: Method;
  /** Share of the live light, by irradiance, that the gains do not explain: 0 … 1 and above. */
  residual: number;
  /** Coefficients that are added to the field everywhere, `(bands², 3)`; `null`: they are negligible. */
  rest: Float32Array | null;
}

/** Light groups have gains of their own where these leave less than this of the live light; else something is new. */
const GROUPS_EXPLAIN = 0.05;
/** Once they have, they keep them up to here, so that noise about the limit does not make the light flicker. */
const GROUPS_STILL_EXPLAIN = 0.06;
/** Below this share the rest is noise and calibration, and is left out. */
const NEGLIGIBLE = 0.01;

interface Attempt {
  gains: Vector3[];
  residual: number;
  rest: Float32Array;
}

/**
 * Multiply the fields with gains, and add a rest, so that they are the live light where the probe stands; `fields` are
 * their coefficients there. Several fields are light groups: their gains `g ≥ 0` are least squares weighted by `A_l²`.
 * Where these do not explain the light, and where there is one field, the sum b of the fields has one gain
 * `⟨ℓ, b⟩ / ⟨b, b⟩`. A channel in which the field is black gets no gain: all of its light is rest.
 *
 * `before`: the method of the moment before.
 */
export function modulate(live: Coefficients, fields: readonly Coefficients[], before: Method | null = null): Modulation {
  const products = new Products(live, fields);
  const own = fields.length > 1 ? products.attempt((channel) => products.groupGains(channel)) : null;
  const method: Method = own !== null && own.residual < (before === "groups" ? GROUPS_STILL_EXPLAIN : GROUPS_EXPLAIN) ? "groups" : "gain";
  const { gains, residual, rest } =
    method === "groups" ? own! : products.attempt((channel) => fields.map(() => products.commonGain(channel)));
  return { gains, method, residual, rest: residual < NEGLIGIBLE ? null : rest };
}

/** Products of the live light and the fields with each other, a channel, weighted by `A_l²`. */
class Products {
  private readonly weights: number[];

  constructor(
    private readonly live: Coefficients,
    private readonly fields: readonly Coefficients[],
  ) {
    const count = live.length / 3;
    const factors = lambertFactors(Math.ceil(Math.sqrt(count)));
    this.weights = Array.from({ length: count }, (_, i) => factors[Math.floor(Math.sqrt(i))]! ** 2);
  }

  groupGains(channel: number): number[] {
    const { fields, live } = this;
    const gram = fields.map((one) => fields.map((other) => this.product(one, other, channel)));
    return nonnegativeGains(gram, fields.map((field) => this.product(field, live, channel)));
  }

  commonGain(channel: number): number {
    let across = 0;
    let square = 0;
    for (const one of this.fields) {
      across += this.product(one, this.live, channel);
      for (const other of this.fields) square += this.product(one, other, channel);
    }
    // A negative gain would turn the field inside out.
    return square > 0 ? Math.max(0, across / square) : 0;
  }

  attempt(gainsOf: (channel: number) => number[]): Attempt {
    const { live, fields, weights } = this;
    const channels = [0, 1, 2].map(gainsOf);
    const gains = fields.map((_, k) => channels.map((channel) => channel[k]!) as unknown as Vector3);
    const rest = new Float32Array(live.length);
    let left = 0;
    let all = 0;
    for (let i = 0; i < live.length; i++) {
      const explained = fields.reduce((sum, field, k) => sum + gains[k]![i % 3]! * (field[i] ?? 0), 0);
      rest[i] = live[i]! - explained;
      const weight = weights[Math.floor(i / 3)]!;
      left += weight * rest[i]! ** 2;
      all += weight * live[i]! ** 2;
    }
    return { gains, rest, residual: all > 0 ? Math.sqrt(left / all) : 0 };
  }

  private product(one: Coefficients, other: Coefficients, channel: number): number {
    return this.weights.reduce((sum, weight, i) => sum + weight * (one[3 * i + channel] ?? 0) * (other[3 * i + channel] ?? 0), 0);
  }
}
