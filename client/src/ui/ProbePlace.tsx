import { useState } from "preact/hooks";

import { middleOf } from "../grid/illuminate.ts";
import { point } from "../jobs/words.ts";
import { probeStands, snapshot } from "../session.ts";
import { change, view } from "../view.ts";

const AXES = ["x", "y", "z"];

/** A number in metres, taken when it has been typed to its end; what is being typed is left alone meanwhile. */
function Metres({ label, value, onChange }: { label: string; value: number; onChange: (value: number) => void }) {
  const [draft, setDraft] = useState<string | null>(null);
  return (
    <input
      type="number"
      step={0.05}
      value={draft ?? String(Number(value.toFixed(3)))}
      aria-label={label}
      onInput={(event) => setDraft(event.currentTarget.value)}
      onChange={(event) => {
        setDraft(null);
        if (Number.isFinite(event.currentTarget.valueAsNumber)) onChange(event.currentTarget.valueAsNumber);
      }}
    />
  );
}

/** Where the live probe stands in the grid: what it sees there is what the grid is held against. */
export function ProbePlace() {
  const { probeAt, at } = view.value;
  const info = snapshot.value?.grid.info ?? null;
  if (info === null) return null;
  const known = snapshot.value?.frame?.position ?? probeStands();
  const stands = known ?? probeAt ?? middleOf(info);
  const outside = stands.some((value, k) => value < info.lower[k]! || value > info.upper[k]!);
  const set = (axis: number, value: number) => change({ probeAt: stands.map((before, k) => (k === axis ? value : before)) });
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
            <Metres key={axis} label={`Live probe, ${axis} in metres`} value={stands[k]!} onChange={(value) => set(k, value)} />
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
