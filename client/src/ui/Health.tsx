import { snapshot } from "../session.ts";
import type { Frame, StreamStatus } from "../wire.ts";

function windowWords({ window }: Frame): string {
  if (window.kind === "none") return "none";
  return window.strength > 0 ? `${window.kind}, λ ${window.strength.toPrecision(2)}` : window.kind;
}

function samplesWords({ quality }: Frame): string {
  const counts = { NaN: quality.nan, Inf: quality.infinite, negative: quality.negative, clipped: quality.saturated };
  const words = Object.entries(counts)
    .filter(([, count]) => count > 0)
    .map(([name, count]) => `${count} ${name}`);
  return words.join(", ") || "all sound";
}

function framesWords(status: StreamStatus): string {
  const words = [`${status.frames_published} published`];
  if (status.frames_skipped > 0) words.push(`${status.frames_skipped} unreadable`);
  if (status.frames_dropped > 0) words.push(`${status.frames_dropped} overtaken`);
  return words.join(", ");
}

/** What happened to the newest frame on its way. */
export function Health() {
  const now = snapshot.value;
  const frame = now?.frame ?? null;
  if (now === null || frame === null) return <p class="muted">No light yet.</p>;
  const rows: [string, string, string][] = [
    ["Window", windowWords(frame), "Window against ringing that the coefficients carry"],
    ["Samples", samplesWords(frame), "Pixels of the newest frame that were not ordinary numbers"],
    ["Unseen", `${(100 * frame.quality.blind_fraction).toFixed(1)} % of the sphere`, "Share of directions that the probe cannot see"],
  ];
  if (now.status !== null) rows.push(["Frames", framesWords(now.status), "Counted by the ingest worker"]);
  if (frame.source_frame !== "") rows.push(["Source", frame.source_frame, "What the source calls the newest frame"]);
  return (
    <>
      <dl class="facts" data-testid="health">
        {rows.map(([name, value, hint]) => (
          <div key={name} title={hint}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {now.status?.last_error ? <p class="last-error">{now.status.last_error}</p> : null}
    </>
  );
}
