import { describe, expect, it } from "vitest";

import type { JsonObject } from "../rest.ts";
import { cellOf, draftOfRows, moved, rowOfCamera, rowsOf, withCell, without } from "./rows.ts";
import { complaint, fieldsOf, settingsOf, written } from "./schema.ts";

// As pydantic writes it.
const SCHEMA: JsonObject = {
  $defs: {
    Key: {
      properties: {
        position: { type: "array", prefixItems: [{ type: "number" }, { type: "number" }, { type: "number" }], description: "where" },
        fov_degrees: { type: "number", default: 36.0 },
      },
      required: ["position"],
      type: "object",
    },
    Camera: { properties: { path: { type: "array", default: [], items: { $ref: "#/$defs/Key" } } }, type: "object" },
  },
  properties: { camera: { $ref: "#/$defs/Camera" } },
  type: "object",
};

describe("lists of objects", () => {
  const fields = fieldsOf(SCHEMA);
  const [path] = fields as [(typeof fields)[number]];
  const [position, fov] = path.columns as [(typeof fields)[number], (typeof fields)[number]];

  it("have a column for each value of an item", () => {
    expect(path).toMatchObject({ path: "camera.path", input: "rows", label: "Camera: path" });
    expect(position).toMatchObject({ path: "position", input: "list", required: true, label: "Position" });
    expect(fov).toMatchObject({ path: "fov_degrees", input: "number", label: "Fov (°)", fallback: 36 });
  });

  it("are what was typed into their cells", () => {
    let rows = rowsOf(undefined);
    expect(rows).toEqual([]);
    rows = [rowOfCamera({ position: [1.23456, -2, 0.5], target: [0, 0, 0], fovDegrees: 36 })];
    rows = withCell([...rows, {}], 1, position, "0, 1, 2");
    rows = withCell(rows, 1, fov, "50");
    rows = withCell(withCell(rows, 0, fov, ""), 1, fov, "wide");
    rows = withCell([...rows, {}], 2, position, "3, ");
    // What is half typed stays as it is.
    expect([cellOf(rows[0]!, position), cellOf(rows[0]!, fov), cellOf(rows[1]!, fov), cellOf(rows[2]!, position)]).toEqual([
      "1.235,-2,0.5",
      "",
      "wide",
      "3, ",
    ]);
    const draft = draftOfRows(rows);
    expect(rowsOf(draft)).toEqual(rows);
    const path = [
      { position: [1.235, -2, 0.5], target: [0, 0, 0] },
      { position: [0, 1, 2], fov_degrees: "wide" },
      { position: 3 },
    ];
    expect(settingsOf(fields, { "camera.path": draft })).toEqual({ camera: { path } });
    // As the settings of an earlier job are put into the form again.
    expect(settingsOf(fields, { "camera.path": written(path) })).toEqual({ camera: { path } });
    expect(settingsOf(fields, { "camera.path": draftOfRows([]) })).toEqual({});
  });

  it("say in which of them something is wrong", () => {
    const wrong = (field: string) => complaint(path, [{ field: `settings.${field}`, message: "is missing" }]);
    expect([wrong("camera.path.1.fov_degrees"), wrong("camera.path.0"), wrong("camera.path"), wrong("camera")]).toEqual([
      "2: fov (°): is missing",
      "1: is missing",
      "is missing",
      "",
    ]);
  });

  it("are moved and removed", () => {
    const rows = [{ position: 1 }, { position: 2 }, { position: 3 }];
    expect(moved(rows, 0, 1)).toEqual([rows[1], rows[0], rows[2]]);
    expect(moved(rows, 2, 1)).toEqual(rows);
    expect(without(rows, 1)).toEqual([rows[0], rows[2]]);
    expect([rowsOf("nothing"), rowsOf('{"a": 1}'), rowsOf("[1, {}]")]).toEqual([[], [], [{}]]);
  });
});
