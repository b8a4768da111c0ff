import { describe, expect, it } from "vitest";

import { refusal, streamName } from "./files.ts";

describe("files", () => {
  it("are taken where they are meshes or maps", () => {
    for (const name of ["a.glb", "B.OBJ", "c.d.ply", "sky.exr", "sky.HDR"]) expect(refusal(name, 10)).toBe("");
  });

  it("are refused with what would do", () => {
    expect(refusal("a.glb", 3e8, 268435456)).toContain("simplify");
    expect(refusal("a.exr", 3e8, 268435456)).toContain("at most 268 MB");
    expect(refusal("photo.jpg", 10)).toContain(".exr");
    expect(refusal("notes.txt", 10)).toContain(".ply");
    expect(refusal("noending", 10)).toContain(".ply");
    expect(refusal("a.glb", 0)).toContain("empty");
  });

  it("give streams their names", () => {
    expect(streamName("Grüner Wald (2k).exr")).toBe("gru-ner-wald-2k");
    expect(streamName("_-.hdr")).toBe("map");
    expect(streamName("esplanade.hdr")).toBe("esplanade");
  });
});
