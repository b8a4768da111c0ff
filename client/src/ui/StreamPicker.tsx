import { nowMs } from "../clock.ts";
import type { Commands } from "../commands.ts";
import { chooseStream, snapshot, streams } from "../session.ts";
import { paused } from "../time.ts";
import { view } from "../view.ts";
import { TimeBar } from "./TimeBar.tsx";

/** Which stream is followed, and which moment of it is shown. */
export function StreamPicker({ commands }: { commands: Commands }) {
  const names = (streams.value ?? []).map(({ name }) => name);
  const { stream } = view.value;
  if (stream !== null && !names.includes(stream)) names.unshift(stream);
  const info = snapshot.value?.info;
  return (
    <div class="stream">
      <label class="picker">
        <span class="label">Stream</span>
        <select
          aria-label="Stream"
          value={stream ?? ""}
          disabled={names.length === 0}
          onChange={(event) => chooseStream(event.currentTarget.value)}
        >
          {names.length === 0 && <option value="">none yet</option>}
          {names.map((name) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      </label>
      <button
        type="button"
        class="follow"
        aria-pressed={paused.value}
        title="Hold the light that is shown, or follow the newest (Space)"
        onClick={() => commands.time.toggle(nowMs())}
      >
        {paused.value ? "Follow" : "Pause"}
      </button>
      <TimeBar commands={commands} />
      {info && (
        <p class="muted source" title={info.source}>
          {info.mapping}, {info.bands} bands, {info.units === "relative" ? "relative units" : "W·sr⁻¹·m⁻²"}
        </p>
      )}
    </div>
  );
}
