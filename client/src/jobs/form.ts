// The form for a new job: which kind, what is typed, what the server says of it. It stays while other tabs are shown.

import { signal } from "@preact/signals";

import { ApiError, words, type FieldError } from "../api.ts";
import { estimateJob, type Estimate, type JsonObject } from "../rest.ts";
import { change } from "../view.ts";
import { fieldsOf, otherComplaints, settingsOf, written, type Draft, type Field } from "./schema.ts";
import { kinds, loadKinds, submit } from "./store.ts";

export interface JobForm {
  kind: string;
  draft: Draft;
  errors: readonly FieldError[];
  problem: string;
  /** What the settings as they are now would need; `null` before it has been asked. */
  estimate: Estimate | null;
  busy: boolean;
  /** Smaller is sooner. */
  priority: number;
}

export const NORMAL_PRIORITY = 100;

/** `null`: closed. */
export const form = signal<JobForm | null>(null);

/** What a form shows at once; other kinds show what is required and the first few. */
const BASIC: Record<string, string[]> = {
  "ilf-grid": ["capture", "resolutions", "bands", "gradients"],
  "prt-transfer": ["mesh", "mode", "directions", "bands", "bounces"],
  "capture-reduce": ["capture", "tolerance", "max_distance_m"],
  "igi-render": [
    "scene",
    "light.stream",
    "light.map",
    "light.frames",
    "camera.name",
    "camera.position",
    "camera.target",
    "camera.orbit_degrees",
    "camera.path",
    "width",
    "height",
    "igi.vpls",
  ],
};
const SHOWN_OF_OTHERS = 4;

export function basicOf(kind: string, fields: readonly Field[]): string[] {
  return BASIC[kind] ?? fields.slice(0, SHOWN_OF_OTHERS).map(({ path }) => path);
}

/** Open the form, and the tab that it stands in. */
export async function openForm(kind: string | null = null, draft: Draft = {}): Promise<void> {
  change({ tab: "jobs", panel: true });
  form.value = { kind: kind ?? "", draft, errors: [], problem: "", estimate: null, busy: false, priority: NORMAL_PRIORITY };
  try {
    await loadKinds();
  } catch (error) {
    note({ problem: words(error) });
    return;
  }
  if (form.value?.kind === "") note({ kind: kinds.value?.[0]?.name ?? "" });
}

/** What would have to be typed to get these settings. */
export function draftOf(settings: JsonObject, prefix = ""): Draft {
  const draft: Record<string, string | boolean> = {};
  for (const [name, value] of Object.entries(settings)) {
    const path = prefix + name;
    if (typeof value === "boolean") draft[path] = value;
    else if (typeof value === "object" && value !== null && !Array.isArray(value)) Object.assign(draft, draftOf(value, `${path}.`));
    else if (value !== null) draft[path] = written(value);
  }
  return draft;
}

export function closeForm(): void {
  form.value = null;
}

export function note(part: Partial<JobForm>): void {
  if (form.peek() !== null) form.value = { ...form.peek()!, ...part };
}

export function fieldsOfKind(kind: string): Field[] {
  const schema = kinds.value?.find(({ name }) => name === kind)?.settings_schema;
  return schema === undefined ? [] : fieldsOf(schema);
}

function typed(): { kind: string; settings: JsonObject } {
  const { kind, draft } = form.peek()!;
  return { kind, settings: settingsOf(fieldsOfKind(kind), draft) };
}

/** Ask what the job would need. */
export async function estimate(): Promise<void> {
  const { kind, settings } = typed();
  await attempt(async () => note({ estimate: await estimateJob(kind, settings) }));
}

export async function submitForm(): Promise<void> {
  const { kind, settings } = typed();
  await attempt(async () => {
    await submit(kind, settings, { priority: form.peek()!.priority });
    closeForm();
  });
}

async function attempt(work: () => Promise<void>): Promise<void> {
  note({ busy: true, problem: "", errors: [] });
  try {
    await work();
  } catch (error) {
    const errors = error instanceof ApiError ? error.fields : [];
    // What stands at its field is not said twice.
    const problem = errors.length > 0 ? otherComplaints(fieldsOfKind(form.peek()?.kind ?? ""), errors) : words(error);
    note({ errors, problem, estimate: null });
  } finally {
    note({ busy: false });
  }
}
