import { ACCEPTED } from "../files.ts";
import { subjectOf, transfers } from "../results.ts";
import { objectIsComing, objectProblem, snapshot } from "../session.ts";
import { takeFiles } from "../uploads.ts";
import { DEFAULT_VIEW, OWN_OBJECTS, RADIUS_RANGE, change, isOfGrid, view, type Size } from "../view.ts";
import { Choice, Meter, Section, Slider, Wrong } from "./controls.tsx";
import { FileButton } from "./FileButton.tsx";

const LABELS: Record<(typeof OWN_OBJECTS)[number], string> = {
  stilllife: "Still life",
  bunny: "Bunny",
  sphere: "Sphere",
};

const SIZES: { value: Size; label: string; hint: string }[] = [
  { value: "fit", label: "Fitted", hint: "As large as is well seen between a grid's walls, or as you say" },
  { value: "true", label: "True", hint: "As large as it is, in metres" },
];

/** How large the object is in a grid, beside how large the grid is. */
function SizeInGrid() {
  const { light, size } = view.value;
  const now = snapshot.value;
  const info = now?.grid.info ?? null;
  if (!isOfGrid(light) || now === null) return null;
  const edges = info?.upper.map((high, k) => Number((high - info.lower[k]!).toPrecision(2))) ?? [];
  return (
    <>
      <Choice label="Size in the grid" value={size} options={SIZES} onChange={(value) => change({ size: value })} />
      {size === "true" && info !== null && (
        <p class="hint" data-testid="sizes">
          {`${(2 * now.objectRadius).toPrecision(2)} m across, ground included; the grid is ${edges.join(" × ")} m.`}
        </p>
      )}
    </>
  );
}

/** How large the object is beside live probes. */
function SizeBesideProbes() {
  const { size, radius } = view.value;
  const now = snapshot.value;
  if (now === null || now.near === null) return null;
  return (
    <>
      <Choice label="Size" value={size} options={SIZES} onChange={(value) => change({ size: value })} />
      {size === "fit" ? (
        <Slider
          label="Radius"
          value={Math.log2(radius)}
          min={Math.log2(RADIUS_RANGE.min)}
          max={Math.log2(RADIUS_RANGE.max)}
          step={0.02}
          shown={`${radius.toPrecision(2)} m`}
          hint="Of the sphere about the object: what is larger is farther from the probe"
          onInput={(log) => change({ radius: Math.min(RADIUS_RANGE.max, Math.max(RADIUS_RANGE.min, 2 ** log)) })}
          onReset={() => change({ radius: DEFAULT_VIEW.radius })}
        />
      ) : (
        <p class="hint">{`${(2 * now.objectRadius).toPrecision(2)} m across, ground included.`}</p>
      )}
    </>
  );
}

/** What is lit: the page's own objects, and meshes whose transfer has been computed. */
export function ObjectSection() {
  const { object } = view.value;
  const finished = transfers.value;
  const isKnown = (OWN_OBJECTS as readonly string[]).includes(object) || finished.some(({ id }) => id === object);
  return (
    <Section title="Object">
      <label class="row">
        <span class="label">Shown</span>
        <select aria-label="Object" value={object} onChange={(event) => change({ object: event.currentTarget.value })}>
          {OWN_OBJECTS.map((name) => (
            <option key={name} value={name}>
              {LABELS[name]}
            </option>
          ))}
          {!isKnown && <option value={object}>{object}</option>}
          {finished.map((job) => (
            <option key={job.id} value={job.id}>
              {subjectOf(job) || job.id}
            </option>
          ))}
        </select>
      </label>
      {objectIsComing.value && <Meter label="Fetching the object" share={null} />}
      <Wrong text={objectProblem.value} />
      <SizeInGrid />
      <SizeBesideProbes />
      <FileButton accept={ACCEPTED} onFiles={takeFiles}>
        Add a mesh or a map…
      </FileButton>
      <p class="hint">
        Or drop a file onto the page. GLB, OBJ, PLY: lit with its own shadows. EXR, HDR: a lat-long map becomes a stream.
      </p>
    </Section>
  );
}
