import { unfinished } from "../jobs/store.ts";
import { point } from "../jobs/words.ts";
import { grids } from "../results.ts";
import { snapshot } from "../session.ts";
import { PAGE_BANDS } from "../sh.ts";
import { change, view, type Axis, type LightSource, type Sampling } from "../view.ts";
import { Coefficients } from "./Coefficients.tsx";
import { gridLabel } from "./GridsTab.tsx";
import { Choice, Meter, Section, Slider, Toggle, Wrong } from "./controls.tsx";

const SOURCES: { value: LightSource; label: string; hint: string }[] = [
  { value: "stream", label: "Live", hint: "The live probe lights everything alike" },
  { value: "grid", label: "Grid", hint: "A captured field: the light depends on the place" },
  { value: "both", label: "Both", hint: "The field, changed as the live probe has changed since" },
];
const BANDS = Array.from({ length: PAGE_BANDS }, (_, i) => ({
  value: i + 1,
  label: String(i + 1),
  hint: `${(i + 1) ** 2} coefficients`,
}));
const AXES: { value: Axis; label: string; hint: string }[] = [
  { value: "x", label: "x", hint: "The slice lies across the x axis" },
  { value: "y", label: "y", hint: "The slice lies across the y axis" },
  { value: "z", label: "z", hint: "The slice is level" },
];
const SAMPLINGS: { value: Sampling; label: string; hint: string }[] = [
  { value: "vertex", label: "Vertex", hint: "The field is looked up at each vertex: fast" },
  { value: "fragment", label: "Pixel", hint: "The field is looked up at each pixel: exact, and slow without a graphics card" },
];

/** Choose where the light comes from; the first grid where none was chosen. */
function chooseSource(light: LightSource): void {
  const before = view.peek();
  // A place from which one sees a grid is none from which one sees the object, and the other way round.
  const camera = (before.light === "stream") === (light === "stream") ? before.camera : null;
  const grid = light === "stream" ? before.grid : (before.grid ?? grids.peek()?.[0]?.id ?? null);
  change({ light, camera, grid });
}

function GridPicker() {
  const { grid, light } = view.value;
  const list = grids.value ?? [];
  if (light === "stream") return null;
  if (grid === null && list.length === 0 && unfinished.value.some(({ kind }) => kind === "ilf-grid")) {
    return (
      <p class="hint">
        A grid is being made and will be shown when it is ready.{" "}
        <button type="button" class="link" onClick={() => change({ tab: "jobs" })}>
          See how far it is
        </button>
      </p>
    );
  }
  if (grid === null && list.length === 0) {
    return (
      <p class="hint">
        There is no finished grid yet.{" "}
        <button type="button" class="link" onClick={() => change({ tab: "captures" })}>
          Make one from a capture
        </button>
      </p>
    );
  }
  return (
    <label class="row">
      <span class="label">Grid</span>
      <select aria-label="Which grid" value={grid ?? ""} onChange={(event) => change({ grid: event.currentTarget.value, at: null })}>
        {grid === null && <option value="">choose…</option>}
        {grid !== null && !list.some(({ id }) => id === grid) && <option value={grid}>{grid}</option>}
        {list.map((item) => (
          <option key={item.id} value={item.id}>
            {gridLabel(item)}
          </option>
        ))}
      </select>
    </label>
  );
}

function GridControls() {
  const { sliceAxis, slice, probes, sampling, at, gizmo } = view.value;
  const state = snapshot.value?.grid;
  const info = state?.info ?? null;
  const axis = "xyz".indexOf(sliceAxis);
  const place = info === null ? null : info.lower[axis]! + slice * (info.upper[axis]! - info.lower[axis]!);
  const middle = info === null ? null : info.lower.map((low, i) => (low + info.upper[i]!) / 2);
  const standing = at ?? middle;
  return (
    <>
      {state !== undefined && state.problem === "" && state.loading < 1 && <Meter label="Loading the grid" share={state.loading} />}
      <Wrong text={state?.problem ?? ""} />
      <Toggle
        label="Move the object"
        hint="Handles that move the object through the grid (G)"
        checked={gizmo}
        onChange={(checked) => change({ gizmo: checked })}
      />
      <p class="row">
        <span class="label">Object at</span>
        <span>
          <span data-testid="at">{standing === null ? "–" : `${point(standing)} m`}</span>{" "}
          {at !== null && (
            <button type="button" class="link" onClick={() => change({ at: null })}>
              to the middle
            </button>
          )}
        </span>
      </p>
      <Toggle
        label="Sample spheres"
        hint="Spheres on a slice of the grid, each lit by the light at its place"
        checked={probes}
        onChange={(checked) => change({ probes: checked })}
      />
      <Choice label="Slice across" value={sliceAxis} options={AXES} onChange={(value) => change({ sliceAxis: value })} />
      <Slider
        label="Slice"
        value={slice}
        min={0}
        max={1}
        step={0.005}
        shown={place === null ? `${(100 * slice).toFixed(0)} %` : `${point([place])} m`}
        onInput={(value) => change({ slice: value })}
        onReset={() => change({ slice: 0.5 })}
      />
      <Choice label="Look up light at each" value={sampling} options={SAMPLINGS} onChange={(value) => change({ sampling: value })} />
    </>
  );
}

/** How well the live light is explained by a change of the field's brightness. */
function ModulationWords() {
  const modulation = snapshot.value?.modulation ?? null;
  if (view.value.light !== "both" || modulation === null) return null;
  const percent = 100 * modulation.residual;
  return (
    <dl class="facts" data-testid="modulation">
      <div title="What the field is multiplied with, red, green and blue">
        <dt>Gain</dt>
        <dd>{modulation.gain.map((value) => value.toPrecision(3)).join("  ")}</dd>
      </div>
      <div title="Share of the live light that no gain of the field explains">
        <dt>Unexplained</dt>
        <dd>
          {percent.toFixed(percent < 10 ? 1 : 0)} %, {modulation.method === "gain" ? "left out" : "added as distant light"}
        </dd>
      </div>
    </dl>
  );
}

export function LightSection() {
  const { light, bands, arrow } = view.value;
  return (
    <Section title="Light" aside={`${bands ** 2} of ${(snapshot.value?.frame?.bands ?? PAGE_BANDS) ** 2} coefficients`}>
      <Choice label="Light from" value={light} options={SOURCES} onChange={chooseSource} />
      <GridPicker />
      <ModulationWords />
      {light !== "stream" && view.value.grid !== null && <GridControls />}
      {light !== "grid" && (
        <>
          <Coefficients />
          <Toggle
            label="Dominant light"
            hint="An arrow that points the way the strongest light travels (A)"
            checked={arrow}
            onChange={(checked) => change({ arrow: checked })}
          />
        </>
      )}
      <Choice label="Bands" value={bands} options={BANDS} onChange={(value) => change({ bands: value })} />
    </Section>
  );
}
