import { MOST_GROUPS } from "../grid/info.ts";
import type { Method } from "../grid/modulate.ts";
import { unfinished } from "../jobs/store.ts";
import { point } from "../jobs/words.ts";
import { grids } from "../results.ts";
import { snapshot } from "../session.ts";
import { PAGE_BANDS } from "../sh.ts";
import { change, isOfGrid, isOfStream, view, type Axis, type LightSource } from "../view.ts";
import { Coefficients } from "./Coefficients.tsx";
import { gridLabel } from "./GridsTab.tsx";
import { FieldPicker, NearControls, SAMPLINGS } from "./NearControls.tsx";
import { ProbePlace } from "./ProbePlace.tsx";
import { Choice, Meter, Section, Slider, Toggle, Wrong } from "./controls.tsx";

const SOURCES: { value: LightSource; label: string; hint: string }[] = [
  { value: "stream", label: "Live", hint: "One live probe: everything alike, or by its gradients" },
  { value: "field", label: "Field", hint: "Several live probes with known places light what is between them" },
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

/** Choose where the light comes from; the first grid where none was chosen. */
function chooseSource(light: LightSource): void {
  const before = view.peek();
  // A place from which one sees a grid is none from which one sees the object, and the other way round.
  const camera = before.light === light || (isOfGrid(before.light) && isOfGrid(light)) ? before.camera : null;
  // A place in a grid means nothing beside probes.
  const at = isOfGrid(before.light) === isOfGrid(light) ? before.at : null;
  const grid = !isOfGrid(light) ? before.grid : (before.grid ?? grids.peek()?.[0]?.id ?? null);
  change({ light, camera, grid, at });
}

/** Show another grid, with the same groups beside it. */
function chooseGrid(grid: string): void {
  change({ grid, groups: view.peek().groups.filter((id) => id !== grid), at: null });
}

function GridPicker() {
  const { grid, light } = view.value;
  const list = grids.value ?? [];
  if (!isOfGrid(light)) return null;
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
      <select aria-label="Which grid" value={grid ?? ""} onChange={(event) => chooseGrid(event.currentTarget.value)}>
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
  const { sliceAxis, slice, probes, sampling, at, gizmo, gradients } = view.value;
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
      {state?.gradients === true && (
        <Toggle
          label="Gradients"
          hint="Between its cells the light bends as its gradients say; without them it is straight from cell to cell"
          checked={gradients}
          onChange={(checked) => change({ gradients: checked })}
        />
      )}
      <Choice label="Look up light at each" value={sampling} options={SAMPLINGS} onChange={(value) => change({ sampling: value })} />
    </>
  );
}

function labelOf(id: string): string {
  const found = grids.value?.find((item) => item.id === id);
  return found === undefined ? id : gridLabel(found);
}

/** Further grids over the same space, one a group of lamps. */
function Groups() {
  const { grid, groups } = view.value;
  if (grid === null) return null;
  const more = (grids.value ?? []).filter(({ id }) => id !== grid && !groups.includes(id));
  return (
    <>
      {groups.map((id) => (
        <p class="row" key={id} data-testid="group">
          <span class="label">Group</span>
          <span title={id}>
            {labelOf(id)}{" "}
            <button type="button" class="link" aria-label={`Remove ${labelOf(id)}`} onClick={() => change({ groups: groups.filter((item) => item !== id) })}>
              remove
            </button>
          </span>
        </p>
      ))}
      {more.length > 0 && groups.length < MOST_GROUPS - 1 && (
        <label class="row" title="One capture for each group of lamps, the others off: their lights add up, and each follows the live probe with a gain of its own">
          <span class="label">Add group</span>
          <select aria-label="Add a light group" value="" onChange={(event) => change({ groups: [...groups, event.currentTarget.value] })}>
            <option value="">choose a grid…</option>
            {more.map((item) => (
              <option key={item.id} value={item.id}>
                {gridLabel(item)}
              </option>
            ))}
          </select>
        </label>
      )}
    </>
  );
}

const METHODS: Record<Method, { words: string; hint: string }> = {
  groups: { words: "each group has its gain", hint: "The live light is a mix of the groups, so each lamp is followed by itself" },
  gain: { words: "one gain for all", hint: "No mix of the groups explains the live light: something is new, or there is one grid" },
};

/** How well the live light is explained by a change of the field's brightness. */
function ModulationWords() {
  const modulation = snapshot.value?.modulation ?? null;
  const { grid, groups } = view.value;
  if (view.value.light !== "both" || modulation === null) return null;
  const percent = 100 * modulation.residual;
  const names = modulation.method === "groups" ? [grid ?? "", ...groups].map(labelOf) : ["Gain"];
  const { words, hint } = METHODS[modulation.method];
  return (
    <dl class="facts" data-testid="modulation">
      {groups.length > 0 && (
        <div title={hint}>
          <dt>Method</dt>
          <dd>{words}</dd>
        </div>
      )}
      {names.map((name, k) => (
        <div key={name} title="What the grid is multiplied with: red, green, blue">
          <dt>{name}</dt>
          <dd>{(modulation.gains[k] ?? []).map((value) => value.toPrecision(3)).join("  ")}</dd>
        </div>
      ))}
      <div title="Share of the live light that the gains do not explain">
        <dt>Unexplained</dt>
        <dd>
          {percent.toFixed(percent < 10 ? 1 : 0)} %, {modulation.rest === null ? "left out" : "added as distant light"}
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
      <FieldPicker />
      {!isOfGrid(light) && <NearControls />}
      {isOfGrid(light) && <Groups />}
      {light === "both" && <ProbePlace />}
      <ModulationWords />
      {isOfGrid(light) && view.value.grid !== null && <GridControls />}
      {isOfStream(light) && (
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
