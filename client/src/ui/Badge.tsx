import { live, snapshot, type Snapshot } from "../session.ts";
import { paused } from "../time.ts";
import { view, type LightSource } from "../view.ts";

interface Look {
  tone: "good" | "busy" | "bad" | "quiet";
  text: string;
}

const WORDS = { starting: "Starting", running: "Stalled", stalled: "Stalled", ended: "Ended", failed: "Failed", stopped: "Stopped" };

/** A picture that does not change, shown again and again. */
const STILL = /^upload:/;

/** The light in a word or two: whose it is, and whether it comes. */
export function describe(now: Snapshot | null, isPaused: boolean, source: LightSource): Look {
  if (source === "stream") return describeStream(now, isPaused);
  if (source === "field") return describeField(now, isPaused);
  const grid = describeGrid(now);
  if (source === "grid" || grid.tone !== "good") return grid;
  const stream = describeStream(now, isPaused);
  return { tone: stream.tone, text: `Grid × ${stream.text.toLowerCase()}` };
}

function describeGrid(now: Snapshot | null): Look {
  const grid = now?.grid;
  if (grid === undefined) return { tone: "busy", text: "Loading the grid" };
  if (grid.problem !== "") return { tone: "bad", text: "No grid" };
  if (grid.loading < 1) return { tone: "busy", text: "Loading the grid" };
  return grid.info === null ? { tone: "quiet", text: "No grid" } : { tone: "good", text: "Grid" };
}

/** What is said while no light comes, of a stream as of a field. */
const CONNECTION: Record<"connecting" | "waiting" | "retrying" | "refused", Look> = {
  connecting: { tone: "busy", text: "Connecting" },
  waiting: { tone: "busy", text: "Waiting for light" },
  retrying: { tone: "bad", text: "Reconnecting" },
  refused: { tone: "bad", text: "Refused" },
};

function describeField(now: Snapshot | null, isPaused: boolean): Look {
  switch (now?.field.state) {
    case undefined:
    case "idle":
      return { tone: "quiet", text: "No field" };
    case "connecting":
    case "waiting":
    case "retrying":
    case "refused":
      return CONNECTION[now.field.state];
    case "stalled":
      return { tone: "busy", text: "Stalled" };
    case "live":
      if (isPaused) return { tone: "quiet", text: "Paused" };
      return { tone: "good", text: `Field of ${now.near?.probes.length ?? 0}` };
  }
}

function describeStream(now: Snapshot | null, isPaused: boolean): Look {
  switch (now?.state) {
    case undefined:
    case "idle":
      return { tone: "quiet", text: "No stream" };
    case "connecting":
    case "waiting":
    case "retrying":
    case "refused":
      return CONNECTION[now.state];
    case "stalled":
      return { tone: "busy", text: WORDS[now.status?.state ?? "stalled"] };
    case "live":
      if (isPaused) return { tone: "quiet", text: "Paused" };
      return { tone: "good", text: STILL.test(now.info?.source ?? "") ? "Static" : "Live" };
  }
}

export function Badge() {
  const { tone, text } = describe(snapshot.value, paused.value, view.value.light);
  return (
    <span class={`badge ${tone}`} role="status" data-testid="badge">
      {text}
    </span>
  );
}

/** What is wrong and what happens next, where something is. */
export function Trouble() {
  const now = snapshot.value;
  if (now === null) return null;
  const seconds = Math.ceil(now.retrySeconds);
  let text = "";
  let retry = false;
  if (now.state === "retrying") {
    text = `${now.problem} Trying again${seconds > 0 ? ` in ${seconds} s` : ""}; the last light stays.`;
    retry = true;
  } else if (now.state === "refused") {
    text = now.problem;
    retry = true;
  } else if (now.state === "connecting" && now.problem !== "") {
    text = `${now.problem} Trying again…`;
  } else if (now.state === "waiting") {
    text = "Connected. The stream has not sent any light yet.";
  } else if (now.state === "stalled") {
    text = `No new light for ${now.silentSeconds.toFixed(0)} s. ${now.status?.last_error ?? ""}`.trim();
  }
  if (text === "") return null;
  return (
    <div class="trouble" role="alert">
      <p>{text}</p>
      {retry && (
        <button type="button" onClick={() => live.retry()}>
          Try now
        </button>
      )}
    </div>
  );
}
