// Times, sizes and numbers for people.

import type { Progress } from "../rest.ts";

/** `75` seconds as "1 min 15 s". */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 10) return `${seconds.toFixed(seconds < 0.95 ? 1 : 0)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min${whole % 60 > 0 ? ` ${whole % 60} s` : ""}`;
  const minutes = Math.round(whole / 60);
  return `${Math.floor(minutes / 60)} h${minutes % 60 > 0 ? ` ${minutes % 60} min` : ""}`;
}

const SIZES = ["B", "kB", "MB", "GB", "TB"];

export function bytes(count: number): string {
  let value = count;
  let unit = 0;
  while (value >= 999.5 && unit < SIZES.length - 1) {
    value /= 1000;
    unit++;
  }
  return `${value.toFixed(unit > 0 && value < 9.95 ? 1 : 0)} ${SIZES[unit]!}`;
}

/** `4000000` as "4.0 M": for rates and counts. */
export function count(value: number): string {
  if (value >= 1e6) return `${(value / 1e6).toFixed(1)} M`;
  if (value >= 1e4) return `${(value / 1e3).toFixed(0)} k`;
  if (value >= 10 || Number.isInteger(value)) return value.toFixed(0);
  return value.toFixed(value < 1 ? 2 : 1);
}

/** How long ago a time in nanoseconds was. */
export function ago(timeNs: number, nowMs: number): string {
  const seconds = Math.max(0, nowMs / 1000 - timeNs / 1e9);
  if (seconds < 5) return "just now";
  if (seconds < 60) return `${Math.round(seconds)} s ago`;
  if (seconds < 3600) return `${Math.round(seconds / 60)} min ago`;
  if (seconds < 86_400) return `${Math.round(seconds / 3600)} h ago`;
  return new Date(timeNs / 1e6).toLocaleDateString(undefined, { day: "numeric", month: "short" });
}

const TITLES: Record<string, string> = {
  "ilf-grid": "Light grid",
  "prt-transfer": "Mesh shadows",
  "capture-reduce": "Thinned capture",
  "igi-render": "Render",
  reproject: "Projected again",
};

/** What a kind of job makes, for people who do not know its name. */
export function kindTitle(kind: string): string {
  return TITLES[kind] ?? kind;
}

/** What a stage is called, with what one would wonder about. */
export function stageWords(stage: string): string {
  return stage === "compile" ? "compile, up to a minute on a new installation" : stage;
}

/** The time that a stage still takes; empty where it is not known, or too short to be told. */
export function leftWords({ eta_seconds, done, total }: Progress): string {
  return eta_seconds === null || eta_seconds < 1 || done >= total ? "" : `${duration(eta_seconds)} left`;
}

/** The last part of a path. */
export function baseName(path: string): string {
  return path.replace(/\/+$/, "").split("/").at(-1) ?? path;
}

export function point(at: readonly number[], digits = 2): string {
  return at.map((value) => String(Number(value.toFixed(digits)) + 0)).join(", "); // + 0: no minus before a zero
}
