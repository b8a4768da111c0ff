// Rows of a field that is a list of objects, such as the cameras of a path: what is typed into their cells, and back.

import type { Json, JsonObject } from "../rest.ts";
import { written, type Field } from "./schema.ts";

export type Row = JsonObject;

/** The rows that a draft stands for; none where it is empty or no list. */
export function rowsOf(typed: string | boolean | undefined): Row[] {
  if (typeof typed !== "string" || typed.trim() === "") return [];
  try {
    const found = JSON.parse(typed) as Json;
    return Array.isArray(found) ? found.filter((row): row is Row => typeof row === "object" && row !== null && !Array.isArray(row)) : [];
  } catch {
    return [];
  }
}

/** The draft of rows; empty: the field has its default. */
export function draftOfRows(rows: readonly Row[]): string {
  return rows.length === 0 ? "" : JSON.stringify(rows);
}

/** What stands in a cell. */
export function cellOf(row: Row, column: Field): string {
  return written(row[column.path]);
}

/** Rows with a cell as it was typed, which `settingsOf` reads; an emptied one has the column's default. */
export function withCell(rows: readonly Row[], at: number, column: Field, text: string): Row[] {
  return rows.map((row, place) => {
    if (place !== at) return row;
    const { [column.path]: _, ...rest } = row;
    return text === "" ? rest : { ...rest, [column.path]: text };
  });
}

/** Rows with one moved by a step, as far as there is room. */
export function moved(rows: readonly Row[], at: number, step: -1 | 1): Row[] {
  const to = at + step;
  if (to < 0 || to >= rows.length) return [...rows];
  const found = [...rows];
  [found[at], found[to]] = [found[to]!, found[at]!];
  return found;
}

/** Rows without one. */
export function without(rows: readonly Row[], at: number): Row[] {
  return rows.filter((_, place) => place !== at);
}

const DIGITS = 3;

/** What a camera shows, as a row: those of the columns that there are. Lengths to the millimetre. */
export function rowOfCamera(camera: { position: readonly number[]; target: readonly number[]; fovDegrees: number }): Row {
  const rounded = (values: readonly number[]) => values.map((value) => Number(value.toFixed(DIGITS)));
  return { position: rounded(camera.position), target: rounded(camera.target), fov_degrees: Number(camera.fovDegrees.toFixed(1)) };
}
