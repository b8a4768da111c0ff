// What the user looks at and how: all of it stands in the address, so that a link shows the same picture.

import { signal } from "@preact/signals";

import { MOST_GROUPS } from "./grid/info.ts";
import { PAGE_BANDS } from "./sh.ts";

export type BackdropMode = "picture" | "harmonics" | "off";
export type Theme = "auto" | "dark" | "light";
/** Where the light comes from: `both` is the grid's, modulated by the stream's; `field`: several streams' together. */
export type LightSource = "stream" | "grid" | "both" | "field";
export type Axis = "x" | "y" | "z";
/** Where a grid's light is looked up. */
export type Sampling = "vertex" | "fragment";
/** The objects that come with the page; any other name is a transfer job. */
export const OWN_OBJECTS = ["stilllife", "bunny", "sphere"] as const;
export const TABS = ["scene", "streams", "jobs", "captures", "grids", "files"] as const;
export type Tab = (typeof TABS)[number];
/** How large the object is: so that it is well seen (between a grid's walls), or as it is in metres. */
export type Size = "fit" | "true";
/** What of the queue is listed. */
export const JOB_STATES = ["queued", "running", "cancelled", "failed", "succeeded"] as const;

export interface View {
  /** `null`: the page picks one. */
  stream: string | null;
  light: LightSource;
  /** Several streams with known places; `null`: the page picks one. */
  field: string | null;
  /** The grid's id, such as `JOB.grid`. */
  grid: string | null;
  /** Further grids over the same space: with the first they are light groups, and add up. */
  groups: readonly string[];
  /** Whether gradients are used, of grids, streams and fields, where they have any. */
  gradients: boolean;
  /** Where the live probe stands, world metres, where its stream does not say; `null`: the grid's middle, or the origin. */
  probeAt: readonly number[] | null;
  /** One of `OWN_OBJECTS`, or the id of a transfer job. */
  object: string;
  /** Where the object stands, world metres; `null`: in the grid's middle, at the probe, amid the field's probes. */
  at: readonly number[] | null;
  size: Size;
  /** Radius of a fitted object beside probes, metres. */
  radius: number;
  /** Whether handles are shown that move the object. */
  gizmo: boolean;
  /** Whether handles are shown that move the live probe, where its stream does not say where it stands. */
  probeGizmo: boolean;
  /** Axis that the shown slice of the grid lies across, and where, 0 … 1. */
  sliceAxis: Axis;
  slice: number;
  /** Whether sample spheres stand on the grid's slice, and where live probes are. */
  probes: boolean;
  sampling: Sampling;
  /** Exposure in EV; `null`: metered, following the light slowly. */
  ev: number | null;
  /** Camera position and target, world metres; `null`: the framed start. */
  camera: readonly number[] | null;
  colour: string;
  gloss: number;
  exponent: number;
  /** Weight of the mirrored backdrop, 0 … 1 (equation 15 of paper 003). */
  mirror: number;
  shadows: boolean;
  bands: number;
  backdrop: BackdropMode;
  arrow: boolean;
  /** `null`: open where the window is wide. */
  panel: boolean | null;
  tab: Tab;
  /** Jobs that are listed: of this state and kind; `null`: of all. */
  jobState: (typeof JOB_STATES)[number] | null;
  jobKind: string | null;
  hud: boolean;
  theme: Theme;
}

export const DEFAULT_VIEW: View = {
  stream: null,
  light: "stream",
  field: null,
  grid: null,
  groups: [],
  gradients: true,
  probeAt: null,
  object: "stilllife",
  at: null,
  size: "fit",
  radius: 0.25,
  gizmo: false,
  probeGizmo: false,
  sliceAxis: "z",
  slice: 0.5,
  probes: true,
  sampling: "vertex",
  ev: null,
  camera: null,
  colour: "#d8d2c8",
  gloss: 0.15,
  exponent: 12,
  mirror: 0,
  shadows: true,
  bands: PAGE_BANDS,
  backdrop: "picture",
  arrow: false,
  panel: null,
  tab: "scene",
  jobState: null,
  jobKind: null,
  hud: true,
  theme: "auto",
};

export const EV_RANGE = { min: -8, max: 8 };
/** Metres. */
export const RADIUS_RANGE = { min: 0.02, max: 5 };
export const EXPONENT_RANGE = { min: 1, max: 128 };

type Codec<T> = { read: (text: string) => T | undefined; write: (value: T) => string };

const text: Codec<string> = { read: (value) => value || undefined, write: (value) => value };
const flag: Codec<boolean> = {
  read: (value) => (value === "1" ? true : value === "0" ? false : undefined),
  write: (value) => (value ? "1" : "0"),
};
const number = (min: number, max: number, digits: number): Codec<number> => ({
  read: (value) => (value !== "" && Number(value) >= min && Number(value) <= max ? Number(value) : undefined),
  write: (value) => String(Number(value.toFixed(digits))),
});
const choice = <T extends string>(...names: T[]): Codec<T> => ({
  read: (value) => names.find((name) => name === value),
  write: (value) => value,
});
const colour: Codec<string> = {
  read: (value) => (/^[0-9a-f]{6}$/.test(value) ? `#${value}` : undefined),
  write: (value) => value.slice(1),
};
const numbers = (count: number): Codec<readonly number[]> => ({
  read: (value) => {
    const parts = value.split(",");
    const read = parts.map(Number);
    const sound = read.length === count && parts.every((part) => part !== "") && read.every(Number.isFinite);
    return sound ? read : undefined;
  },
  write: (value) => value.map((item) => Number(item.toFixed(3))).join(","),
});
/** An id of the server: what no id can be is not asked for. */
const id: Codec<string> = {
  read: (value) => (/^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$/.test(value) ? value : undefined),
  write: (value) => value,
};

const ids = (most: number): Codec<readonly string[]> => ({
  read: (value) => {
    const read = value.split(",").map(id.read);
    return read.length <= most && read.every((item) => item !== undefined) ? [...new Set(read)] : undefined;
  },
  write: (value) => value.join(","),
});

const CODECS: { [Key in keyof View]: Codec<NonNullable<View[Key]>> } = {
  stream: text,
  light: choice("stream", "grid", "both", "field"),
  field: id,
  grid: id,
  groups: ids(MOST_GROUPS - 1),
  gradients: flag,
  probeAt: numbers(3),
  object: id,
  at: numbers(3),
  size: choice("fit", "true"),
  radius: number(RADIUS_RANGE.min, RADIUS_RANGE.max, 3),
  gizmo: flag,
  probeGizmo: flag,
  sliceAxis: choice("x", "y", "z"),
  slice: number(0, 1, 3),
  probes: flag,
  sampling: choice("vertex", "fragment"),
  ev: number(EV_RANGE.min, EV_RANGE.max, 2),
  camera: numbers(6),
  colour,
  gloss: number(0, 1, 2),
  exponent: number(EXPONENT_RANGE.min, EXPONENT_RANGE.max, 1),
  mirror: number(0, 1, 2),
  shadows: flag,
  bands: { read: (value) => (/^[1-5]$/.test(value) ? Number(value) : undefined), write: String },
  backdrop: choice("picture", "harmonics", "off"),
  arrow: flag,
  panel: flag,
  tab: choice(...TABS),
  jobState: choice(...JOB_STATES),
  jobKind: id,
  hud: flag,
  theme: choice("auto", "dark", "light"),
};

/** Read a hash; what is missing or makes no sense is the default. */
export function parseView(hash: string): View {
  const parameters = new URLSearchParams(hash.replace(/^#/, ""));
  const view: Record<string, unknown> = { ...DEFAULT_VIEW };
  for (const [key, codec] of Object.entries(CODECS)) {
    const value = parameters.get(key);
    const read = value === null ? undefined : codec.read(value);
    if (read !== undefined) view[key] = read;
  }
  return view as unknown as View;
}

/** Write what differs from the default. */
export function formatView(view: View): string {
  const parts: string[] = [];
  for (const [key, codec] of Object.entries(CODECS) as [keyof View, Codec<unknown>][]) {
    const value = view[key];
    if (value === null) continue;
    const written = codec.write(value);
    const fallback = DEFAULT_VIEW[key];
    if (fallback === null || written !== codec.write(fallback)) {
      parts.push(`${key}=${encodeURIComponent(written).replaceAll("%2C", ",")}`);
    }
  }
  return parts.length > 0 ? `#${parts.join("&")}` : "";
}

/** Whether the light comes from grids, with or without the live light. */
export const isOfGrid = (light: LightSource): boolean => light === "grid" || light === "both";
/** Whether the chosen stream lights, alone or through a grid. */
export const isOfStream = (light: LightSource): boolean => light === "stream" || light === "both";

export const view = signal<View>(DEFAULT_VIEW);

export function change(part: Partial<View>): void {
  view.value = { ...view.value, ...part };
}

/** Keep the view and the address the same, both ways. */
export function bindViewToAddress(): void {
  const read = () => {
    const next = parseView(location.hash);
    if (formatView(next) !== formatView(view.peek())) view.value = next;
  };
  read();
  addEventListener("hashchange", read);
  let timer: ReturnType<typeof setTimeout> | undefined;
  view.subscribe((value) => {
    // Browsers allow about a hundred changes of the address in thirty seconds; dragging makes more.
    clearTimeout(timer);
    timer = setTimeout(() => history.replaceState(null, "", formatView(value) || location.pathname + location.search), 300);
  });
}
