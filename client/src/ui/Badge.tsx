import { live, snapshot, type Snapshot } from "../session.ts";
import { paused } from "../time.ts";

interface Look {
  tone: "good" | "busy" | "bad" | "quiet";
  text: string;
}

const WORDS = { starting: "Starting", running: "Stalled", stalled: "Stalled", ended: "Ended", failed: "Failed", stopped: "Stopped" };

/** The connection in one word. */
export function describe(now: Snapshot | null, isPaused: boolean): Look {
  switch (now?.state) {
    case undefined:
    case "idle":
      return { tone: "quiet", text: "No stream" };
    case "connecting":
      return { tone: "busy", text: "Connecting" };
    case "waiting":
      return { tone: "busy", text: "Waiting for light" };
    case "retrying":
      return { tone: "bad", text: "Reconnecting" };
    case "refused":
      return { tone: "bad", text: "Refused" };
    case "stalled":
      return { tone: "busy", text: WORDS[now.status?.state ?? "stalled"] };
    case "live":
      return isPaused ? { tone: "quiet", text: "Paused" } : { tone: "good", text: "Live" };
  }
}

export function Badge() {
  const { tone, text } = describe(snapshot.value, paused.value);
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
