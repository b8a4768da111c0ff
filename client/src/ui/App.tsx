import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import { Commands, helpIsOpen, isWide, message } from "../commands.ts";
import { startJobs } from "../jobs/store.ts";
import { startResults } from "../results.ts";
import { live, liveField, startSession, streams, streamsProblem } from "../session.ts";
import { TimeTravel } from "../time.ts";
import { resumeArrivals } from "../uploads.ts";
import { TABS, change, view } from "../view.ts";
import { Viewport } from "../viewport.ts";
import { DropZone } from "./DropZone.tsx";
import { Help } from "./Help.tsx";
import { Hud } from "./Hud.tsx";
import { Panel } from "./Panel.tsx";
import { PictureDialog } from "./PictureDialog.tsx";
import { Starting } from "./Starting.tsx";
import { Tray } from "./Tray.tsx";

const PREFERS_LIGHT = matchMedia("(prefers-color-scheme: light)");
const TYPED = "select, textarea, input:not([type=checkbox], [type=radio], [type=range], [type=color])";
const WORKING_KEYS = new Set([" ", "+", "-", ".", ","]);
const WIDE = matchMedia("(min-width: 720px)");

/** Where there is nothing to show, what to do about it. */
function Empty() {
  if (view.value.stream !== null) return null;
  const problem = streamsProblem.value;
  if (problem !== "") {
    return (
      <div class="empty" role="alert">
        <h2>The server cannot be reached</h2>
        <p>{problem} This page keeps trying.</p>
        <pre>lightwell serve</pre>
      </div>
    );
  }
  if (streams.value === null || streams.value.length > 0) return null;
  return (
    <div class="empty" role="status">
      <h2>No streams yet</h2>
      <p>Start one; this page will follow it by itself.</p>
      <pre>lightwell ingest synthetic:room --stream room</pre>
      <p>
        Or drop a lat-long map (EXR, HDR) onto the page, run <code>lightwell demo</code> for samples, or{" "}
        <button type="button" class="link" onClick={() => change({ tab: "streams", panel: true })}>
          add a stream here
        </button>
        .
      </p>
    </div>
  );
}

export function App() {
  const canvas = useRef<HTMLCanvasElement>(null);
  const panel = useRef<HTMLElement>(null);
  const commands = useSignal<Commands | null>(null);
  const failure = useSignal("");
  const softwareRenderer = useSignal("");

  useEffect(() => {
    let viewport: Viewport;
    try {
      viewport = new Viewport(canvas.current!, live, liveField);
    } catch (error) {
      failure.value = `This browser offers no WebGL 2, which the picture needs. ${(error as Error).message}`;
      return;
    }
    if (viewport.isSoftware) {
      softwareRenderer.value = viewport.rendererName;
      document.documentElement.classList.add("software");
    }
    const follow = () => (isWide.value = WIDE.matches);
    follow();
    WIDE.addEventListener("change", follow);
    const time = new TimeTravel(live, viewport);
    const made = new Commands(viewport, time);
    commands.value = made;
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]") !== null) return;
      const target = event.target as HTMLElement;
      // Where one types, letters are letters; switches and buttons keep the keys that work them.
      if (target.matches(TYPED) || (WORKING_KEYS.has(event.key) && target.matches("input, button, summary, a"))) return;
      const tab = TABS[Number(event.key) - 1];
      if (tab !== undefined) {
        change({ tab, panel: true });
        return;
      }
      if (made.press(event.key.toLowerCase(), target === canvas.current, event.shiftKey)) event.preventDefault();
    });
    startSession(viewport, time);
    startJobs();
    startResults();
    resumeArrivals();
    viewport.start().catch((error: unknown) => {
      failure.value = `The objects could not be loaded: ${(error as Error).message}`;
    });
    const measure = () => {
      const box = panel.current?.getBoundingClientRect();
      if (box === undefined) return;
      const open = made.panelIsOpen();
      viewport.cover({
        right: open && isWide.value ? innerWidth - box.left : 0,
        bottom: isWide.value ? 0 : innerHeight - box.top,
      });
    };
    const observer = new ResizeObserver(measure);
    // The panel is there after the render that `commands` has just caused.
    requestAnimationFrame(() => {
      measure();
      if (panel.current !== null) observer.observe(panel.current);
    });
  }, []);

  const { theme, hud } = view.value;
  useEffect(() => {
    const resolve = () => {
      document.documentElement.dataset["theme"] = theme !== "auto" ? theme : PREFERS_LIGHT.matches ? "light" : "dark";
    };
    resolve();
    PREFERS_LIGHT.addEventListener("change", resolve);
    return () => PREFERS_LIGHT.removeEventListener("change", resolve);
  }, [theme]);

  return (
    <>
      <canvas
        ref={canvas}
        tabIndex={0}
        aria-label="Objects lit by the stream. Arrow keys orbit, plus and minus zoom, question mark lists the keys."
      />
      {hud && <Hud />}
      <Empty />
      {failure.value !== "" && (
        <div class="empty" role="alert">
          <h2>No picture</h2>
          <p>{failure.value}</p>
        </div>
      )}
      {softwareRenderer.value !== "" && (
        <div class="notice" role="note" data-testid="software-notice" title={softwareRenderer.value}>
          <p>WebGL runs in software: motion is slow.</p>
          <button type="button" aria-label="Dismiss" onClick={() => (softwareRenderer.value = "")}>
            ×
          </button>
        </div>
      )}
      {commands.value !== null ? <Panel commands={commands.value} element={panel} /> : failure.value === "" && <Starting />}
      <div class="message" role="status" aria-live="polite">
        {message.value}
      </div>
      <Tray />
      <DropZone />
      <PictureDialog />
      {helpIsOpen.value && <Help onClose={() => (helpIsOpen.value = false)} />}
    </>
  );
}
