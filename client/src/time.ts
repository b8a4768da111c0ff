// Live, paused, or somewhere in the last half minute.

import { signal } from "@preact/signals";

import { HISTORY_MS, type Light, type LiveStream, type PastPicture } from "./live.ts";
import { luminance } from "./sh.ts";

/** What is shown of the light that has been. */
export interface Timeline {
  /** Mean luminance over the span, oldest first, as (seconds before the end, value). */
  levels: readonly (readonly [number, number])[];
  /** Seconds before the end of what is shown; 0 where the newest is followed. */
  back: number;
  /** Seconds that there are to go back. */
  span: number;
}

interface Held {
  past: readonly Light[];
  pictures: readonly PastPicture[];
  endMs: number;
  shown: Light | null;
}

/** What shows the light: the viewport. */
export interface Shower {
  paused: boolean;
  readonly shown: Light | null;
  setTime(light: Light | null, picture?: PastPicture["picture"] | null): void;
}

const POINTS = 120;

export const paused = signal(false);
export const timeline = signal<Timeline>({ levels: [], back: 0, span: 0 });

export class TimeTravel {
  /** The last half minute as it was when the light was paused: while one looks into it, it does not move on. */
  private held: Held | null = null;

  constructor(
    private readonly live: LiveStream,
    private readonly shower: Shower,
  ) {}

  pause(timeMs: number): void {
    if (this.held !== null) return;
    this.live.updatePast(timeMs);
    const { past, pastPictures } = this.live;
    this.held = { past, pictures: pastPictures, endMs: past.at(-1)?.receivedMs ?? timeMs, shown: this.shower.shown };
    this.shower.paused = true;
    paused.value = true;
    this.refresh(timeMs);
  }

  follow(timeMs: number): void {
    this.held = null;
    this.shower.paused = false;
    this.shower.setTime(null);
    paused.value = false;
    this.refresh(timeMs);
  }

  toggle(timeMs: number): void {
    if (this.held === null) this.pause(timeMs);
    else this.follow(timeMs);
  }

  /** Show the light of so many seconds before the end. */
  seek(secondsBack: number, timeMs: number): void {
    this.pause(timeMs);
    const held = this.held!;
    const wanted = held.endMs - 1000 * secondsBack;
    this.show(nearest(held.past, wanted), timeMs);
  }

  /** Go one frame on, or back. */
  step(frames: number, timeMs: number): void {
    this.pause(timeMs);
    const { past, shown } = this.held!;
    const index = shown === null ? past.length - 1 : past.indexOf(shown);
    this.show(past[Math.min(past.length - 1, Math.max(0, index + frames))] ?? null, timeMs);
  }

  /** Bring the timeline up to date; a few times a second. */
  refresh(timeMs: number): void {
    this.live.updatePast(timeMs);
    const past = this.held?.past ?? this.live.past;
    const endMs = this.held?.endMs ?? timeMs;
    const shownMs = this.held?.shown?.receivedMs ?? endMs;
    const span = past.length > 1 ? Math.min(HISTORY_MS, endMs - past[0]!.receivedMs) / 1000 : 0;
    timeline.value = { levels: levels(past, endMs), back: Math.max(0, endMs - shownMs) / 1000, span };
  }

  private show(light: Light | null, timeMs: number): void {
    if (light === null) return;
    const held = this.held!;
    held.shown = light;
    this.shower.setTime(light, nearest(held.pictures, light.receivedMs)?.picture ?? null);
    this.refresh(timeMs);
  }
}

function nearest<T extends { receivedMs: number }>(items: readonly T[], timeMs: number): T | null {
  let best: T | null = null;
  for (const item of items) {
    if (best === null || Math.abs(item.receivedMs - timeMs) < Math.abs(best.receivedMs - timeMs)) best = item;
  }
  return best;
}

/** Mean luminance, thinned out to what a timeline can show. */
function levels(past: readonly Light[], endMs: number): (readonly [number, number])[] {
  const stride = Math.max(1, Math.ceil(past.length / POINTS));
  return past
    .filter((_, index) => (past.length - 1 - index) % stride === 0)
    .map(({ coefficients, receivedMs }) => [
      (endMs - receivedMs) / 1000,
      luminance(coefficients[0]!, coefficients[1]!, coefficients[2]!),
    ]);
}
