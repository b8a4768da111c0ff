// What keys and buttons do.

import { signal } from "@preact/signals";

import { nowMs } from "./clock.ts";
import type { TimeTravel } from "./time.ts";
import { change, formatView, view, type BackdropMode } from "./view.ts";
import type { Viewport } from "./viewport.ts";

const ORBIT_STEP = Math.PI / 36;
const ZOOM_STEP = 1.1;
const MOVE_STEP = 0.05;
/** Keys that move the object, with shift the live probe: shares of the grid's box along x, y and z. */
const MOVES: Record<string, [number, number, number]> = {
  n: [-MOVE_STEP, 0, 0],
  m: [MOVE_STEP, 0, 0],
  j: [0, -MOVE_STEP, 0],
  u: [0, MOVE_STEP, 0],
  k: [0, 0, -MOVE_STEP],
  i: [0, 0, MOVE_STEP],
};
const NEXT_BACKDROP: Record<BackdropMode, BackdropMode> = { picture: "harmonics", harmonics: "off", off: "picture" };
const MESSAGE_MS = 2500;

export const isWide = signal(true);
export const helpIsOpen = signal(false);
/** A short word on what a command has done. */
export const message = signal("");

export class Commands {
  private messageTimer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly viewport: Viewport,
    readonly time: TimeTravel,
  ) {}

  panelIsOpen(): boolean {
    return view.value.panel ?? isWide.value;
  }

  togglePanel(): void {
    change({ panel: !this.panelIsOpen() });
  }

  toggleHelp(): void {
    helpIsOpen.value = !helpIsOpen.value;
  }

  async copyLink(): Promise<void> {
    // The exposure that is seen now goes along, whether metered or chosen.
    const hash = formatView({ ...view.peek(), ev: view.peek().ev ?? this.viewport.meteredEv });
    const link = new URL(hash, location.href).href;
    try {
      await navigator.clipboard.writeText(link);
      this.say("Link copied");
    } catch {
      // Browsers keep the clipboard from pages without TLS: let the user copy the address.
      history.replaceState(null, "", hash);
      this.say("The address of this page is the link");
    }
  }

  async saveScreenshot(): Promise<void> {
    const blob = await this.viewport.screenshot();
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `lightwell-${view.peek().stream ?? "page"}-${new Date().toISOString().slice(0, 19).replaceAll(":", "")}.png`;
    link.click();
    URL.revokeObjectURL(link.href);
    this.say("Screenshot saved");
  }

  /** Do what a key stands for; says whether it stands for anything. */
  press(key: string, onCanvas: boolean, shift: boolean): boolean {
    const step = MOVES[key];
    if (step !== undefined) {
      this.viewport.nudge(...step, shift ? "probe" : "object");
      return true;
    }
    if (key === "g" && shift) {
      change({ probeGizmo: !view.peek().probeGizmo });
      return true;
    }
    switch (key) {
      case "r":
        this.viewport.reset();
        return true;
      case "f":
        this.viewport.frame();
        return true;
      case " ":
        this.time.toggle(nowMs());
        return true;
      case ",":
        this.time.step(-1, nowMs());
        return true;
      case ".":
        this.time.step(1, nowMs());
        return true;
      case "g":
        change({ gizmo: !view.peek().gizmo });
        return true;
      case "b":
        change({ backdrop: NEXT_BACKDROP[view.peek().backdrop] });
        return true;
      case "a":
        change({ arrow: !view.peek().arrow });
        return true;
      case "h":
        change({ hud: !view.peek().hud });
        return true;
      case "p":
        this.togglePanel();
        return true;
      case "s":
        void this.saveScreenshot();
        return true;
      case "l":
        void this.copyLink();
        return true;
      case "?":
        this.toggleHelp();
        return true;
    }
    return onCanvas && this.steer(key);
  }

  private steer(key: string): boolean {
    switch (key) {
      case "arrowleft":
        this.viewport.orbit(-ORBIT_STEP, 0);
        return true;
      case "arrowright":
        this.viewport.orbit(ORBIT_STEP, 0);
        return true;
      case "arrowup":
        this.viewport.orbit(0, ORBIT_STEP);
        return true;
      case "arrowdown":
        this.viewport.orbit(0, -ORBIT_STEP);
        return true;
      case "+":
      case "=":
        this.viewport.zoom(1 / ZOOM_STEP);
        return true;
      case "-":
        this.viewport.zoom(ZOOM_STEP);
        return true;
    }
    return false;
  }

  /** Say a short word on what has been done. */
  say(text: string): void {
    message.value = text;
    clearTimeout(this.messageTimer);
    this.messageTimer = setTimeout(() => (message.value = ""), MESSAGE_MS);
  }
}
