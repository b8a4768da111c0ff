// Forms from JSON schemas (as pydantic writes them): a flat list of fields, and settings from what was typed into them.

import type { FieldError } from "../api.ts";
import type { Json, JsonObject } from "../rest.ts";

export type Input = "text" | "number" | "integer" | "flag" | "choice" | "list" | "rows";

export interface Field {
  /** Dotted path in the settings. */
  path: string;
  label: string;
  hint: string;
  input: Input;
  options: readonly string[];
  required: boolean;
  /** What holds where nothing is typed; `undefined` where there is none. */
  fallback: Json | undefined;
  min: number | null;
  max: number | null;
  /** Of rows: what each of them has. */
  columns: readonly Field[];
}

/** What is typed, by path; a field that is not there has its default. */
export type Draft = Readonly<Record<string, string | boolean>>;

const UNITS: Record<string, string> = {
  m: "m",
  seconds: "s",
  degrees: "°",
  mb: "MB",
  hz: "Hz",
  cells: "cells",
};

/** `smoothing_seconds` in words: "Smoothing (s)". */
export function labelOf(path: string): string {
  const parts = path.split(".").map((name) => {
    const pieces = name.split("_");
    const unit = pieces.length > 1 ? UNITS[pieces.at(-1)!] : undefined;
    return unit === undefined ? pieces.join(" ") : `${pieces.slice(0, -1).join(" ")} (${unit})`;
  });
  const label = parts.join(": ");
  return label[0]!.toUpperCase() + label.slice(1);
}

/** The fields of an object's schema, nested objects flattened; `root` holds what `$ref` points into. */
export function fieldsOf(schema: JsonObject, root: JsonObject = schema, prefix = ""): Field[] {
  const required = (schema["required"] as string[] | undefined) ?? [];
  const fields: Field[] = [];
  for (const [name, raw] of Object.entries((schema["properties"] ?? {}) as Record<string, JsonObject>)) {
    const path = prefix + name;
    const resolved = resolve(raw, root);
    const property = { ...withoutNull(resolved, root), ...pick(raw, "default", "description") };
    if (property["properties"] !== undefined) {
      fields.push(...fieldsOf(property, root, `${path}.`));
      continue;
    }
    const columns = columnsOf(property, root);
    fields.push({
      path,
      label: labelOf(path),
      hint: String(raw["description"] ?? resolved["description"] ?? ""),
      input: columns.length > 0 ? "rows" : inputOf(property),
      options: optionsOf(property),
      required: required.includes(name) && prefix === "",
      fallback: "default" in property ? (property["default"] as Json) : undefined,
      min: numberOf(property, "minimum", "exclusiveMinimum"),
      max: numberOf(property, "maximum", "exclusiveMaximum"),
      columns,
    });
  }
  return fields;
}

/** The fields of each item of a list of objects; none where it is a list of anything else. */
function columnsOf(property: JsonObject, root: JsonObject): Field[] {
  const items = property["items"] as JsonObject | undefined;
  const item = property["type"] === "array" && items !== undefined ? resolve(items, root) : {};
  return item["properties"] === undefined ? [] : fieldsOf(item, root);
}

function resolve(schema: JsonObject, root: JsonObject): JsonObject {
  const ref = schema["$ref"];
  if (typeof ref !== "string") return schema;
  let found: Json = root;
  for (const name of ref.replace(/^#\//, "").split("/")) found = (found as JsonObject)[name] ?? {};
  return found as JsonObject;
}

/** `anyOf: [what it is, null]`, as optional values are written, without the null. */
function withoutNull(schema: JsonObject, root: JsonObject): JsonObject {
  const choices = schema["anyOf"] as JsonObject[] | undefined;
  if (choices === undefined) return schema;
  const kept = choices.filter((choice) => choice["type"] !== "null");
  return kept.length === 1 ? resolve(kept[0]!, root) : {};
}

function pick(schema: JsonObject, ...names: string[]): JsonObject {
  return Object.fromEntries(names.filter((name) => name in schema).map((name) => [name, schema[name]!]));
}

function optionsOf(property: JsonObject): string[] {
  if ("const" in property) return [String(property["const"])];
  return ((property["enum"] as Json[] | undefined) ?? []).map(String);
}

function inputOf(property: JsonObject): Input {
  if ("enum" in property || "const" in property) return "choice";
  switch (property["type"]) {
    case "boolean":
      return "flag";
    case "integer":
      return "integer";
    case "number":
      return "number";
    case "string":
      return "text";
    default:
      return "list";
  }
}

function numberOf(property: JsonObject, ...names: string[]): number | null {
  for (const name of names) {
    if (typeof property[name] === "number") return property[name];
  }
  return null;
}

/** How a value looks in an input. Lists are numbers with commas between them, rows with semicolons; objects are JSON. */
export function written(value: Json | undefined): string {
  if (value === undefined || value === null) return "";
  if (Array.isArray(value) && value.some((item) => typeof item === "object" && item !== null && !Array.isArray(item))) {
    return JSON.stringify(value);
  }
  if (!Array.isArray(value)) return typeof value === "object" ? JSON.stringify(value) : String(value);
  return value.map((item) => (Array.isArray(item) ? item.join(",") : String(item))).join(value.some(Array.isArray) ? "; " : ",");
}

/**
 * The value that a text stands for in a field that is a list: `32` a number, `1,0,0` numbers, `64,64,32; 32` rows.
 * JSON is read as such; anything else is handed on as it is, so that the server says what is wrong with it.
 */
export function listFrom(text: string): Json {
  if (/^[[{]/.test(text)) {
    try {
      return JSON.parse(text) as Json;
    } catch {
      return text;
    }
  }
  const rows = text.split(";").map((row) => row.trim()).filter((row) => row !== "");
  const values = rows.map((row): Json => {
    const numbers = row.split(/[,×x\s]+/).filter((part) => part !== "").map(Number);
    if (numbers.some((number) => !Number.isFinite(number))) return row;
    return numbers.length === 1 ? numbers[0]! : numbers;
  });
  return values.length === 1 ? values[0]! : values;
}

/** The settings that a draft stands for: only what differs from the defaults. */
export function settingsOf(fields: readonly Field[], draft: Draft): JsonObject {
  const settings: JsonObject = {};
  for (const field of fields) {
    const typed = draft[field.path];
    if (typed === undefined) continue;
    const value = valueOf(field, typed);
    if (value === undefined || written(value) === written(field.fallback)) continue;
    put(settings, field.path.split("."), value);
  }
  return settings;
}

/** The value that something typed stands for; `undefined`: the default. */
export function valueOf(field: Field, typed: string | boolean): Json | undefined {
  if (typeof typed === "boolean") return typed;
  const text = typed.trim();
  if (text === "") return undefined;
  if (field.input === "number" || field.input === "integer") return Number.isFinite(Number(text)) ? Number(text) : text;
  if (field.input === "rows") return rowsFrom(field, listFrom(text));
  return field.input === "list" ? listFrom(text) : text;
}

/** Rows whose cells are as they were typed, or values already. */
function rowsFrom(field: Field, rows: Json): Json {
  if (!Array.isArray(rows)) return rows;
  return rows.map((row) => {
    if (typeof row !== "object" || row === null || Array.isArray(row)) return row;
    const found: JsonObject = {};
    for (const [name, cell] of Object.entries(row)) {
      const column = field.columns.find(({ path }) => path === name);
      const value = column !== undefined && typeof cell === "string" ? valueOf(column, cell) : cell;
      if (value !== undefined) found[name] = value;
    }
    return found;
  });
}

function put(target: JsonObject, path: string[], value: Json): void {
  const [name, ...rest] = path as [string, ...string[]];
  if (rest.length === 0) target[name] = value;
  else put((target[name] ??= {}) as JsonObject, rest, value);
}

/** A value below a dotted path. */
export function valueAt(settings: JsonObject, path: string): Json | undefined {
  let found: Json | undefined = settings;
  for (const name of path.split(".")) {
    found = typeof found === "object" && found !== null && !Array.isArray(found) ? found[name] : undefined;
  }
  return found;
}

/** Changes of settings as a JSON merge patch: `null` where a field was emptied, which restores its default. */
export function patchOf(fields: readonly Field[], draft: Draft, before: JsonObject): JsonObject {
  const patch: JsonObject = {};
  for (const field of fields) {
    const typed = draft[field.path];
    if (typed === undefined) continue;
    const value = valueOf(field, typed) ?? null;
    if (written(value) !== written(valueAt(before, field.path))) put(patch, field.path.split("."), value);
  }
  return patch;
}

/** Whether a message of the server is about a field; it names fields inside lists, too. */
function isAbout(error: FieldError, field: Field): boolean {
  const path = error.field.replace(/^settings\./, "");
  return path === field.path || path.startsWith(`${field.path}.`);
}

/** The message of the server that is about a field; empty: nothing is wrong with it. */
export function complaint(field: Field, errors: readonly FieldError[]): string {
  const error = errors.find((one) => isAbout(one, field));
  if (error === undefined) return "";
  // Of a list of objects: in which, counted as people do, and which of its values.
  const [row, name] = error.field.replace(/^settings\./, "").slice(field.path.length + 1).split(".") as [string, string?];
  if (field.input !== "rows" || row === "") return error.message;
  const column = field.columns.find(({ path }) => path === name);
  return `${Number(row) + 1}: ${column === undefined ? "" : `${column.label.toLowerCase()}: `}${error.message}`;
}

/** What is wrong with no single one of these fields, such as a section whose values do not go together; empty: nothing. */
export function otherComplaints(fields: readonly Field[], errors: readonly FieldError[]): string {
  const others = errors.filter((error) => !fields.some((field) => isAbout(error, field)));
  return others.map(({ field, message }) => `${field.replace(/^settings\./, "")}: ${message}`).join("; ");
}
