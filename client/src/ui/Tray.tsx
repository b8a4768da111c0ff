import { jobs } from "../jobs/store.ts";
import { leftWords, stageWords } from "../jobs/words.ts";
import { arrivals, type Arrival } from "../arrivals.ts";
import { again, dismiss, show, stop } from "../uploads.ts";
import { change, view } from "../view.ts";
import { Meter } from "./controls.tsx";

/** How far a file is: the share that is done, and words. */
function progressOf(arrival: Arrival): { share: number | null; text: string } {
  switch (arrival.phase) {
    case "waiting":
      return { share: 0, text: "waits for the upload before it" };
    case "uploading":
      return arrival.sent < 1
        ? { share: arrival.sent, text: `uploading, ${(100 * arrival.sent).toFixed(0)} %` }
        : { share: null, text: "being checked by the server" };
    case "computing": {
      const job = jobs.value?.find(({ id }) => id === arrival.job);
      const progress = job?.progress ?? null;
      if (progress === null || progress.total <= 0) {
        return { share: null, text: job?.state === "queued" ? "waits in the queue" : "shadows are being computed" };
      }
      const share = progress.done / progress.total;
      const parts = [stageWords(progress.stage), `${(100 * share).toFixed(0)} %`, leftWords(progress)];
      return { share, text: `shadows: ${parts.filter((part) => part !== "").join(", ")}` };
    }
    case "ready":
      return { share: 1, text: readyWords(arrival) };
    case "failed":
      return { share: 1, text: arrival.problem };
    case "cancelled":
      return { share: 1, text: "cancelled" };
  }
}

function isSeen(arrival: Arrival): boolean {
  const { object, stream } = view.value;
  return arrival.kind === "map" ? arrival.stream === stream : arrival.job === object;
}

function readyWords(arrival: Arrival): string {
  if (arrival.kind === "map") return isSeen(arrival) ? `is the stream ${arrival.stream}, and lights the scene` : `is the stream ${arrival.stream}`;
  return isSeen(arrival) ? "is shown, with shadows" : "is ready";
}

function Entry({ arrival }: { arrival: Arrival }) {
  const { share, text } = progressOf(arrival);
  const isRunning = arrival.phase === "waiting" || arrival.phase === "uploading" || arrival.phase === "computing";
  return (
    <li class={arrival.phase} data-testid="arrival">
      <div class="words">
        <strong title={arrival.name}>{arrival.name}</strong>
        <span role={arrival.phase === "failed" ? "alert" : "status"}>{text}</span>
      </div>
      {isRunning && <Meter label={`${arrival.name}: ${text}`} share={share} />}
      <div class="buttons">
        {arrival.phase === "ready" && !isSeen(arrival) && (
          <button type="button" onClick={() => show(arrival.key)}>
            {arrival.kind === "map" ? "Follow" : "Show"}
          </button>
        )}
        {arrival.job !== null && arrival.phase !== "ready" && (
          <button type="button" onClick={() => change({ panel: true, tab: "jobs" })}>
            Job
          </button>
        )}
        {isRunning && (
          <button type="button" onClick={() => void stop(arrival.key)}>
            Cancel
          </button>
        )}
        {(arrival.phase === "failed" || arrival.phase === "cancelled") && arrival.again && (
          <button type="button" onClick={() => again(arrival.key)}>
            Try again
          </button>
        )}
        {!isRunning && (
          <button type="button" aria-label={`Dismiss ${arrival.name}`} onClick={() => dismiss(arrival.key)}>
            ×
          </button>
        )}
      </div>
    </li>
  );
}

/** Files on their way. */
export function Tray() {
  const list = arrivals.value;
  if (list.length === 0) return null;
  const settled = list.filter(({ phase }) => phase === "ready" || phase === "failed" || phase === "cancelled");
  return (
    <div class="tray">
      <ul aria-label="Files">
        {list.map((arrival) => (
          <Entry key={arrival.key} arrival={arrival} />
        ))}
      </ul>
      {settled.length > 1 && (
        <button type="button" onClick={() => settled.forEach(({ key }) => dismiss(key))}>
          Dismiss these {settled.length}
        </button>
      )}
    </div>
  );
}
