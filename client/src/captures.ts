// The captures that the server knows.

import { signal } from "@preact/signals";

import { words } from "./api.ts";
import { listCaptures, type Capture } from "./rest.ts";

export const captures = signal<Capture[] | null>(null);
export const capturesProblem = signal("");

export async function refreshCaptures(): Promise<void> {
  try {
    captures.value = await listCaptures();
    capturesProblem.value = "";
  } catch (error) {
    capturesProblem.value = words(error);
  }
}
