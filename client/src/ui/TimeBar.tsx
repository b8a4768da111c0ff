import { nowMs } from "../clock.ts";
import type { Commands } from "../commands.ts";
import { HISTORY_MS } from "../live.ts";
import { paused, timeline } from "../time.ts";

const SPAN = HISTORY_MS / 1000;
const HEIGHT = 26;

/** The brightness of the last half minute, and what moment of it is shown. */
export function TimeBar({ commands }: { commands: Commands }) {
  const { levels, back, span } = timeline.value;
  const most = levels.reduce((largest, [, value]) => Math.max(largest, value), 1e-9);
  const line = levels
    .map(([seconds, value]) => `${(SPAN - seconds).toFixed(2)},${(HEIGHT - 2 - (HEIGHT - 4) * Math.max(0, value / most)).toFixed(1)}`)
    .join(" ");
  const first = levels[0];
  const isPaused = paused.value;
  const words = !isPaused ? "following the newest" : back < 0.05 ? "held" : `${back.toFixed(1)} s back`;
  return (
    <div class="time" data-testid="time">
      <div class="lane">
        <svg viewBox={`0 0 ${SPAN} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
          {first !== undefined && (
            <polygon points={`${(SPAN - first[0]).toFixed(2)},${HEIGHT} ${line} ${(SPAN - levels.at(-1)![0]).toFixed(2)},${HEIGHT}`} />
          )}
        </svg>
        <input
          type="range"
          min={-SPAN}
          max={0}
          step={0.1}
          value={-back}
          disabled={span === 0}
          aria-label="Time"
          aria-valuetext={words}
          title="Look back over the last half minute (, and . go frame by frame)"
          onInput={(event) => commands.time.seek(Math.min(span, -event.currentTarget.valueAsNumber), nowMs())}
          onDblClick={() => commands.time.follow(nowMs())}
        />
      </div>
      <p class="muted">
        <span>−{SPAN} s</span>
        <span class={isPaused ? "held" : ""} data-testid="time-words">
          {words}
        </span>
        <span>now</span>
      </p>
    </div>
  );
}
