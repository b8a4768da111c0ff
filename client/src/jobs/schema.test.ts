import { describe, expect, it } from "vitest";

import type { JsonObject } from "../rest.ts";
import { complaint, fieldsOf, labelOf, listFrom, otherComplaints, patchOf, settingsOf, written } from "./schema.ts";

// As pydantic writes it.
const SCHEMA: JsonObject = {
  $defs: {
    Window: {
      type: "object",
      properties: {
        kind: { default: "none", enum: ["none", "auto"], type: "string", description: "which window" },
        width: { anyOf: [{ exclusiveMinimum: 0, type: "number" }, { type: "null" }], default: null },
      },
    },
  },
  properties: {
    capture: { type: "string", minLength: 1, description: "id of a capture" },
    resolutions: { type: "array", default: [[32, 32, 32]] },
    bands: { type: "integer", default: 5, minimum: 1, maximum: 6 },
    compare: { type: "boolean", default: true },
    window: { $ref: "#/$defs/Window", default: { kind: "none", width: null } },
  },
  required: ["capture"],
  type: "object",
};

describe("forms from schemas", () => {
  const fields = fieldsOf(SCHEMA);
  const field = (path: string) => fields.find((item) => item.path === path)!;

  it("have one field for each value, with bounds, options and defaults", () => {
    expect(fields.map(({ path }) => path)).toEqual(["capture", "resolutions", "bands", "compare", "window.kind", "window.width"]);
    expect(field("capture")).toMatchObject({ input: "text", required: true, fallback: undefined, hint: "id of a capture" });
    expect(field("bands")).toMatchObject({ input: "integer", min: 1, max: 6, fallback: 5 });
    expect(field("window.kind")).toMatchObject({ input: "choice", options: ["none", "auto"], label: "Window: kind" });
    expect(field("window.width")).toMatchObject({ input: "number", min: 0, fallback: null });
    expect(written(field("resolutions").fallback)).toBe("32,32,32");
  });

  it("say units in the label", () => {
    expect(labelOf("max_distance_m")).toBe("Max distance (m)");
    expect(labelOf("filter.tau_seconds")).toBe("Filter: tau (s)");
    expect(labelOf("bands")).toBe("Bands");
  });

  it("send what differs from the defaults, and what makes no sense as it is", () => {
    const draft = { capture: " stage ", resolutions: "64x64x32; 16", bands: "5", compare: false, "window.kind": "auto" };
    expect(settingsOf(fields, draft)).toEqual({
      capture: "stage",
      resolutions: [[64, 64, 32], 16],
      compare: false,
      window: { kind: "auto" },
    });
    expect(settingsOf(fields, { bands: "many", resolutions: "fine" })).toEqual({ bands: "many", resolutions: "fine" });
  });

  it("read lists of numbers as people write them", () => {
    expect(listFrom("32")).toBe(32);
    expect(listFrom("0, 0, -1")).toEqual([0, 0, -1]);
    expect(listFrom("-1,-1,-1; 1,1,1")).toEqual([[-1, -1, -1], [1, 1, 1]]);
    expect(listFrom('{"ball": [1, 0, 0]}')).toEqual({ ball: [1, 0, 0] });
    expect(listFrom("[1, 2")).toBe("[1, 2");
  });

  it("make merge patches of what was changed", () => {
    const before = { capture: "stage", bands: 5, window: { kind: "auto", width: 4 } };
    expect(patchOf(fields, { capture: "stage", bands: "3", "window.width": "" }, before)).toEqual({
      bands: 3,
      window: { width: null },
    });
    expect(patchOf(fields, { "window.kind": "auto", bands: "5" }, before)).toEqual({});
  });
});

describe("what the server complains of", () => {
  it("stands at its field, or beside the form where it is about no single one", () => {
    const fields = fieldsOf(SCHEMA);
    const errors = [
      { field: "settings.bands", message: "is too large" },
      { field: "settings.resolutions.0.1", message: "must be whole" },
      { field: "settings.window", message: "a box needs both corners" },
    ];
    const at = (path: string) => complaint(fields.find((field) => field.path === path)!, errors);
    expect([at("bands"), at("resolutions"), at("capture")]).toEqual(["is too large", "must be whole", ""]);
    expect(otherComplaints(fields, errors)).toBe("window: a box needs both corners");
    expect(otherComplaints(fields, errors.slice(0, 2))).toBe("");
  });
});
