// What can be set of a stream: the schema is the server's, and stands in its OpenAPI document.

import { ask } from "./api.ts";
import { fieldsOf, type Field } from "./jobs/schema.ts";
import type { JsonObject } from "./rest.ts";

let known: Promise<Field[]> | null = null;

/** The fields of a stream's settings; asked for once. */
export function streamFields(): Promise<Field[]> {
  known ??= read().catch((error: unknown) => {
    known = null;
    throw error;
  });
  return known;
}

async function read(): Promise<Field[]> {
  const document = await ask<JsonObject>("openapi.json");
  const schemas = (document["components"] as JsonObject)["schemas"] as JsonObject;
  const creation = schemas["StreamCreation"] as { properties: { settings: { $ref: string } } };
  const name = creation.properties.settings.$ref.split("/").at(-1)!;
  return fieldsOf(schemas[name] as JsonObject, document);
}
