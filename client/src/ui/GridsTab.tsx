import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

import { here, words } from "../api.ts";
import { nowMs } from "../clock.ts";
import { MOST_GROUPS } from "../grid/info.ts";
import { ago, bytes, point } from "../jobs/words.ts";
import { getGrid, sampleGrid, type GridSummary, type JsonObject, type PointSample } from "../rest.ts";
import { grids, gridsProblem, refreshResults } from "../results.ts";
import { irradiance, luminance } from "../sh.ts";
import { change, isOfGrid, view } from "../view.ts";
import { showPicture } from "./PictureDialog.tsx";
import { Choice, Command, Meter, Nothing, Wrong } from "./controls.tsx";

const NORMALS = [
  { value: "0,0,1", label: "up", hint: "Surfaces that face up" },
  { value: "0,0,-1", label: "down", hint: "Surfaces that face down" },
  { value: "1,0,0", label: "+x", hint: "Surfaces that face +x" },
  { value: "-1,0,0", label: "−x", hint: "Surfaces that face −x" },
  { value: "0,1,0", label: "+y", hint: "Surfaces that face +y" },
  { value: "0,-1,0", label: "−y", hint: "Surfaces that face −y" },
];
const FACES: [string, [number, number, number]][] = [
  ["from above", [0, 0, 1]],
  ["from below", [0, 0, -1]],
];

/** A grid in a few words: its capture, its cells. */
export function gridLabel({ id, capture, resolution, adaptive }: GridSummary): string {
  if (resolution === null) return id;
  return `${capture} ${resolution.join("×")}${adaptive ? " adaptive" : ""}`;
}

function coefficientsOf({ coefficients }: PointSample): Float32Array {
  return Float32Array.from(coefficients.flat());
}

/** What the field says of one place, in figures. */
function SampleWords({ sample }: { sample: PointSample }) {
  const coefficients = coefficientsOf(sample);
  const facts: [string, string][] = FACES.map(([name, normal]) => {
    const [red, green, blue] = irradiance(coefficients, normal);
    return [`Irradiance ${name}`, luminance(red, green, blue).toPrecision(3)];
  });
  facts.push(["Measured", `${(100 * sample.coverage).toFixed(0)} % of the sphere`]);
  return (
    <dl class="facts" data-testid="sample">
      {facts.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function middleOf(attributes: JsonObject): number[] {
  const lower = attributes["lower_m"] as number[];
  const upper = attributes["upper_m"] as number[];
  return lower.map((low, i) => (low + upper[i]!) / 2);
}

function GridDetails({ grid }: { grid: GridSummary }) {
  const attributes = useSignal<JsonObject | null>(null);
  const sample = useSignal<PointSample | null>(null);
  const problem = useSignal("");
  const normal = useSignal("0,0,1");
  const { at } = view.value;
  const place = at ?? (attributes.value === null ? null : middleOf(attributes.value));
  const failed = (error: unknown) => (problem.value = words(error));
  useEffect(() => {
    getGrid(grid.id).then((found) => (attributes.value = found.attributes), failed);
  }, [grid.id]);
  const take = () => {
    if (place !== null) sampleGrid(grid.id, place).then((found) => (sample.value = found), failed);
  };
  const facts = attributes.value;
  return (
    <div class="stack">
      <Wrong text={problem.value} />
      {facts === null && problem.value === "" && <Meter label="Asking" share={null} />}
      {facts !== null && (
        <dl class="facts">
          <div>
            <dt>From</dt>
            <dd>{point(facts["lower_m"] as number[])} m</dd>
          </div>
          <div>
            <dt>To</dt>
            <dd>{point(facts["upper_m"] as number[])} m</dd>
          </div>
          <div>
            <dt>Bands</dt>
            <dd>
              {String(facts["bands"])}, window {String(facts["window"])}
            </dd>
          </div>
          <div>
            <dt>Units</dt>
            <dd>{String(facts["units"])}</dd>
          </div>
        </dl>
      )}
      <Choice label="Facing" value={normal.value} options={NORMALS} onChange={(value) => (normal.value = value)} />
      <button
        type="button"
        class="picture"
        aria-label="Slices with axes, larger"
        title="The irradiance in the three middle slices; click for axes and scales"
        onClick={() => showPicture(gridLabel(grid), here(`grids/${grid.id}/plot?normal=${normal.value}`))}
      >
        <img src={here(`grids/${grid.id}/preview?normal=${normal.value}`)} alt="Irradiance in the grid's three middle slices" />
      </button>
      <div class="buttons">
        <button type="button" onClick={take} disabled={place === null}>
          Sample at {at === null ? "the middle" : "the object"}
        </button>
      </div>
      {sample.value !== null && (
        <>
          <p class="muted">At {point(sample.value.at)} m</p>
          <SampleWords sample={sample.value} />
        </>
      )}
      <p class="hint">For engines and notebooks:</p>
      <Command line={`lightwell grid export ${grid.id} --format three grid.json`} />
    </div>
  );
}

/** Add a grid to the one that is shown, or take it away again. */
function GroupButton({ id }: { id: string }) {
  const { grid, groups, light } = view.value;
  if (!isOfGrid(light) || grid === null || grid === id) return null;
  if (groups.includes(id)) {
    return (
      <button type="button" onClick={() => change({ groups: groups.filter((item) => item !== id) })}>
        Remove group
      </button>
    );
  }
  return groups.length < MOST_GROUPS - 1 ? (
    <button
      type="button"
      title="Another group of lamps over the same space: its light is added to that of the grid that is shown"
      onClick={() => change({ groups: [...groups, id] })}
    >
      Add as light group
    </button>
  ) : null;
}

function GridCard({ grid }: { grid: GridSummary }) {
  const { grid: chosen, groups, light } = view.value;
  const isFirst = chosen === grid.id && isOfGrid(light);
  const isShown = isFirst || (groups.includes(grid.id) && isOfGrid(light));
  const open = useSignal(false);
  return (
    <article class={isShown ? "card chosen" : "card"} aria-label={gridLabel(grid)} data-testid="grid">
      <header>
        <h3>{gridLabel(grid)}</h3>
        {isShown && <span class="badge good">{isFirst ? "shown" : "light group"}</span>}
      </header>
      <p class="muted" title={grid.id}>
        {ago(grid.finished_ns, nowMs())}, {bytes(grid.bytes)}
      </p>
      <div class="buttons">
        {isFirst ? (
          <button type="button" onClick={() => change({ light: "stream", camera: null })}>
            Back to the stream
          </button>
        ) : (
          <button
            type="button"
            class="primary"
            onClick={() => change({ grid: grid.id, groups: [], light: "grid", at: null, camera: null })}
          >
            Open
          </button>
        )}
        <GroupButton id={grid.id} />
      </div>
      <details onToggle={(event) => (open.value = event.currentTarget.open)}>
        <summary>Look into it</summary>
        {open.value && <GridDetails grid={grid} />}
      </details>
    </article>
  );
}

/** Finished grids. */
export function GridsTab() {
  useEffect(() => void refreshResults(), []);
  const list = grids.value;
  return (
    <div class="list">
      <Wrong text={gridsProblem.value} />
      {list === null && gridsProblem.value === "" && <p class="muted">Asking the server…</p>}
      {list?.length === 0 && (
        <Nothing title="No grids yet">
          <p>A grid holds the light at every point of a volume. It is made from a capture: many probes, tracked.</p>
          <button type="button" class="primary" onClick={() => change({ tab: "captures" })}>
            Captures
          </button>
        </Nothing>
      )}
      {list?.map((grid) => (
        <GridCard key={grid.id} grid={grid} />
      ))}
    </div>
  );
}
