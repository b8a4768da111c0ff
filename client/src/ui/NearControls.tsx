import { fields, fieldsProblem, liveField, snapshot } from "../session.ts";
import { change, view, type Sampling } from "../view.ts";
import type { Near } from "../viewport.ts";
import { PlaceInput } from "./Place.tsx";
import { ProbePlace } from "./ProbePlace.tsx";
import { Choice, Toggle, Wrong } from "./controls.tsx";

export const SAMPLINGS: { value: Sampling; label: string; hint: string }[] = [
  { value: "vertex", label: "Vertex", hint: "What depends on the place is looked up at each vertex: fast" },
  { value: "fragment", label: "Pixel", hint: "What depends on the place is looked up at each pixel: exact, and slow without a graphics card" },
];

/** Which field lights, and which of its streams do. */
export function FieldPicker() {
  const { field, light } = view.value;
  const list = fields.value ?? [];
  const now = snapshot.value?.field;
  if (light !== "field") return null;
  if (field === null && list.length === 0) {
    return (
      <>
        <p class="hint">
          There is no field yet: two or more streams whose probes stand at known places.{" "}
          <button type="button" class="link" onClick={() => change({ tab: "streams" })}>
            Make one
          </button>
        </p>
        <Wrong text={fieldsProblem.value} />
      </>
    );
  }
  const lost = now !== undefined && ["retrying", "refused"].includes(now.state) ? now.problem : "";
  return (
    <>
      <label class="row">
        <span class="label">Field</span>
        <select aria-label="Which field" value={field ?? ""} onChange={(event) => change({ field: event.currentTarget.value, at: null })}>
          {field !== null && !list.some(({ name }) => name === field) && <option value={field}>{field}</option>}
          {list.map(({ name }) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      </label>
      <Wrong text={lost}>
        <button type="button" onClick={() => liveField.retry()}>
          Try now
        </button>
      </Wrong>
      {now?.members.map(({ stream, problem }) => problem !== "" && <p class="hint" key={stream}>{`${stream}: ${problem}`}</p>)}
    </>
  );
}

const metres = (value: number): string => `${value.toFixed(value < 10 ? 2 : 1)} m`;

/** How far each probe is from the object, and how far it is trusted. */
function Trust({ near }: { near: Near }) {
  const rows = near.probes.map(({ name, position, light: { frame } }) => ({
    name,
    distance: Math.hypot(...position.map((value, k) => value - near.place[k]!)),
    trust: frame.trust_radius_m,
  }));
  // Between the probes of a field light is right farther from each than one alone would be.
  const beyond = rows.length === 1 && rows[0]!.trust !== null && rows[0]!.distance + near.radius > rows[0]!.trust;
  return (
    <>
      <dl class="facts" data-testid="trust">
        {rows.map(({ name, distance, trust }) => (
          <div key={name} title="From the probe to the object's middle; with its gradient its light is within about 10 % up to the trust radius, the ring">
            <dt>{rows.length === 1 ? "From the probe" : name}</dt>
            <dd>
              {metres(distance)}
              {trust !== null && <small>{`, trusted to ${metres(trust)}`}</small>}
            </dd>
          </div>
        ))}
      </dl>
      {beyond && view.value.gradients && <p class="hint">Parts of the object are farther from the probe than its light is trusted.</p>}
    </>
  );
}

/** The object beside live probes: where both stand, and how its light is drawn. */
export function NearControls() {
  const { light, at, gizmo, gradients, probes, sampling } = view.value;
  const near = snapshot.value?.near ?? null;
  if (near === null) return null;
  const haveGradients = near.probes.every(({ light: { gradients } }) => gradients !== null);
  return (
    <>
      <Wrong text={near.problem} />
      <Toggle
        label="Gradients"
        hint={
          haveGradients
            ? "How the light changes beside the probe; without, it is what it is at the probe"
            : "Not all of these streams have gradients: give them a proxy in their settings"
        }
        checked={gradients && haveGradients}
        disabled={!haveGradients}
        onChange={(checked) => change({ gradients: checked })}
      />
      <Trust near={near} />
      <PlaceInput name="Object" hint="Where the middle of the object is" place={near.place} onChange={(place) => change({ at: place })}>
        {at !== null && (
          <button type="button" class="link" onClick={() => change({ at: null })}>
            {near.probes.length === 1 ? "to the probe" : "amid the probes"}
          </button>
        )}
      </PlaceInput>
      <Toggle label="Move the object" hint="Handles that move the object (G)" checked={gizmo} onChange={(checked) => change({ gizmo: checked })} />
      {light === "stream" && <ProbePlace />}
      <Toggle
        label="Show probes"
        hint="Spheres where the probes stand, and rings as far as their light is trusted"
        checked={probes}
        onChange={(checked) => change({ probes: checked })}
      />
      <Choice label="Look up light at each" value={sampling} options={SAMPLINGS} onChange={(value) => change({ sampling: value })} />
    </>
  );
}
