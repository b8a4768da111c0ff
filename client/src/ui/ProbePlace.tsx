import { middleOf } from "../grid/illuminate.ts";
import { point } from "../jobs/words.ts";
import { probeStands, snapshot } from "../session.ts";
import type { Vector3 } from "../sh.ts";
import { change, isOfGrid, view } from "../view.ts";
import { PlaceInput } from "./Place.tsx";
import { Toggle } from "./controls.tsx";

/** Where the live probe stands: in a grid, which is held against what it sees there, or beside the object. */
export function ProbePlace() {
  const { probeAt, probeGizmo, at, light } = view.value;
  const info = isOfGrid(light) ? (snapshot.value?.grid.info ?? null) : null;
  if (isOfGrid(light) && info === null) return null;
  const known = snapshot.value?.frame?.position ?? probeStands();
  const home: Vector3 = info === null ? [0, 0, 0] : middleOf(info);
  const stands = (known ?? probeAt ?? home) as Vector3;
  const outside = info !== null && stands.some((value, k) => value < info.lower[k]! || value > info.upper[k]!);
  return (
    <>
      {known !== null ? (
        <p class="row" title="The stream says so: position_m in its settings, or its frames">
          <span class="label">Live probe at</span>
          <span data-testid="probe-at">{point([...known])} m</span>
        </p>
      ) : (
        <>
          <PlaceInput
            name="Live probe"
            hint="The stream's settings do not say it: position_m"
            place={stands}
            onChange={(place) => change({ probeAt: place })}
          >
            <button type="button" class="link" onClick={() => change({ probeAt: at ?? home })}>
              where the object is
            </button>
            {probeAt !== null && (
              <button type="button" class="link" onClick={() => change({ probeAt: null })}>
                {info === null ? "the origin" : "the middle"}
              </button>
            )}
          </PlaceInput>
          <Toggle
            label="Move the probe"
            hint="Handles that move the live probe (Shift G)"
            checked={probeGizmo}
            onChange={(checked) => change({ probeGizmo: checked })}
          />
        </>
      )}
      {outside && <p class="hint">That is outside the grid: it is held against the light at the grid's edge.</p>}
    </>
  );
}
