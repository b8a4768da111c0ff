import { describe, expect, it, vi } from "vitest";

import { tileCount } from "./grid/layout.ts";
import { MOST_ATTRIBUTES, MOST_TEXTURES, MOST_VARYINGS, litShader, type MemberVariant, type Variant } from "./shader.ts";

// Thousands of shaders: a second here, more on a busy machine.
vi.setConfig({ testTimeout: 60_000 });

/** Attributes that three declares in every shader. */
const BUILT_IN = 3;

/** From one plain grid to four of all sorts. */
function members(stored: number, which: number): MemberVariant[] {
  const plain: MemberVariant = { form: "cells", stored, columns: 5, bendColumns: null };
  const bent: MemberVariant = { ...plain, bendColumns: 8 };
  const bricks: MemberVariant = { ...plain, form: "bricks" };
  const other: MemberVariant = { ...bent, stored: 1 + (stored % 5) };
  return [[plain], [bent], [bricks], [plain, other], [bricks, bricks, bricks, bricks], [bent, bent, other, bent]][which % 6]!;
}

function* variants(): Generator<Variant> {
  for (let bands = 1; bands <= 5; bands++) {
    for (const stored of [0, 1, 2, 3, 4, 5]) {
      for (const sampling of stored === 0 ? (["vertex"] as const) : (["vertex", "fragment"] as const)) {
        for (const transfer of [null, "attributes", "texture"] as const) {
          for (const transferBands of transfer === null ? [0] : [1, 2, 3, 4, 5]) {
            for (const glossy of [false, true]) {
              // What is independent of each other varies together: all pairs occur, and the test stays short.
              for (const [k, mirror] of (["none", "picture", "harmonics"] as const).entries()) {
                for (const flags of k === 0 ? [0, 1, 2, 3] : [k, 3]) {
                  yield {
                    bands,
                    distant: (flags & 1) === 1 || stored === 0,
                    field: stored === 0 ? null : { sampling, members: members(stored, flags + 2 * k) },
                    transfer: transfer === null ? null : { bands: transferBands, from: transfer },
                    glossy,
                    mirror,
                    coloured: (flags & 2) === 2,
                    axes: "lightwell",
                  };
                }
              }
            }
          }
        }
      }
    }
  }
}

/** Slots of 4 floats that declarations take at most (none shares a slot). */
function slots(text: string, keyword: string): number {
  return [...text.matchAll(new RegExp(`^\\s*${keyword} (?:highp )?\\w+ \\w+;`, "gm"))].length;
}

const texts = [...variants()].map((variant) => ({ variant, ...litShader(variant) }));

describe("every variant of the lit material", () => {
  it("is one of thousands", () => expect(texts.length).toBeGreaterThan(3000));

  it("uses few enough texture units, attributes and varyings", () => {
    for (const { variant, vertexShader, fragmentShader } of texts) {
      const textures = [...`${vertexShader}\n${fragmentShader}`.matchAll(/uniform (?:highp )?u?sampler\dD \w+/g)].length;
      const name = JSON.stringify(variant);
      expect(textures, name).toBeLessThanOrEqual(MOST_TEXTURES);
      expect(slots(vertexShader, "attribute") + BUILT_IN, name).toBeLessThanOrEqual(MOST_ATTRIBUTES);
      expect(slots(vertexShader, "varying"), name).toBeLessThanOrEqual(MOST_VARYINGS);
    }
  });

  it("hands over exactly what the other shader takes", () => {
    const varyings = (text: string) => [...text.matchAll(/^varying (\w+ \w+);/gm)].map(([, name]) => name).sort();
    for (const { variant, vertexShader, fragmentShader } of texts) {
      expect(varyings(vertexShader), JSON.stringify(variant)).toEqual(varyings(fragmentShader));
    }
  });

  it("indexes arrays with constants, and has neither loop nor branch", () => {
    for (const { variant, vertexShader, fragmentShader } of texts) {
      const name = JSON.stringify(variant);
      for (const text of [vertexShader, fragmentShader]) {
        expect(text.match(/\w\[(?!\d+\])/), name).toBeNull();
        expect(text.match(/\b(for|while|if|switch|undefined|NaN|null)\b/), name).toBeNull();
      }
    }
  });

  it("fetches each texel of a field once, and none that it does not need", () => {
    const count = ({ vertexShader, fragmentShader }: (typeof texts)[number]) =>
      [...`${vertexShader}${fragmentShader}`.matchAll(/textureLod\(field/g)].length;
    for (const text of texts) {
      const { field } = text.variant;
      const most = field?.members.reduce((sum, { stored, bendColumns }) => sum + tileCount(stored) * (bendColumns === null ? 1 : 4), 0);
      expect(count(text)).toBeLessThanOrEqual(most ?? 0);
    }
    const plain = texts.find(
      ({ variant: { bands, field, transfer, glossy } }) => bands === 4 && field?.members.length === 1 && field.members[0]!.stored === 5 && transfer === null && !glossy,
    )!;
    expect(plain.variant.field!.members[0]!.bendColumns).toBeNull();
    expect(count(plain)).toBe(9); // nine coefficients make the irradiance
  });
});
