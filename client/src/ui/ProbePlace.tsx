import { middleOf } from "../grid/illuminate.ts";
import { point } from "../jobs/words.ts";
import { probeStands, snapshot } from "../session.ts";
import { change, view } from "../view.ts";

const AXES = ["x", "y", "z"];

/** Where the live probe stands in the grid: what it sees there is what the grid is held against. */
export function ProbePlace() {
  const { probeAt, at } = view.value;
  const info = snapshot.value?.grid.info ?? null;
  if (info === null) return null;
  const known = snapshot.value?.frame?.position ?? probeStands();
  const stands = known ?? probeAt ?? middleOf(info);
  const outside = stands.some((value, k) => value < info.lower[k]! || value > info.upper[k]!);
  const set = (axis: number, value: number) => {
    if (Number.isFinite(value)) change({ probeAt: stands.map((before, k) => (k === axis ? value : before)) });
  };
  return (
    <>
      {known !== null ? (
        <p class="row" title="The stream says so: position_m in its settings, or its frames">
          <span class="label">Live probe at</span>
          <span data-testid="probe-at">{point([...known])} m</span>
        </p>
      ) : (
        <fieldset class="place" title="The stream's settings do not say it: position_m">
          <legend class="label">Live probe at, metres</legend>
          {AXES.map((axis, k) => (
            <input
              key={axis}
              type="number"
              step={0.05}
              value={Number(stands[k]!.toFixed(3))}
              aria-label={`Live probe, ${axis} in metres`}
              onChange={(event) => set(k, event.currentTarget.valueAsNumber)}
            />
          ))}
          <button type="button" class="link" onClick={() => change({ probeAt: at ?? middleOf(info) })}>
            where the object is
          </button>
          {probeAt !== null && (
            <button type="button" class="link" onClick={() => change({ probeAt: null })}>
              the middle
            </button>
          )}
        </fieldset>
      )}
      {outside && <p class="hint">That is outside the grid: it is held against the light at the grid's edge.</p>}
    </>
  );
}
