import { useEffect } from "preact/hooks";

import { captures, refreshCaptures } from "../captures.ts";
import { NORMAL_PRIORITY, basicOf, closeForm, estimate, fieldsOfKind, form, note, submitForm } from "../jobs/form.ts";
import { rowOfCamera } from "../jobs/rows.ts";
import { kinds } from "../jobs/store.ts";
import { bytes, duration, kindTitle } from "../jobs/words.ts";
import { grids, refreshResults, uploads } from "../results.ts";
import { fields as lightFields, shownCamera, streams } from "../session.ts";
import { SchemaForm, type Suggestion } from "./SchemaForm.tsx";
import { Wrong } from "./controls.tsx";

const ORDERS = [
  { priority: NORMAL_PRIORITY / 10, label: "before others" },
  { priority: NORMAL_PRIORITY, label: "in turn" },
  { priority: NORMAL_PRIORITY * 10, label: "after others" },
];

function choicesOf(): Record<string, Suggestion[]> {
  const choices: Record<string, Suggestion[]> = {};
  const known = (captures.value ?? []).filter(({ valid }) => valid);
  if (known.length > 0) {
    choices["capture"] = known.map(({ id, probes }) => ({ value: id, label: `${id} (${probes} probes)` }));
  }
  const meshes = (uploads.value ?? []).filter(({ kind }) => kind === "mesh");
  if (meshes.length > 0) choices["mesh"] = meshes.map(({ id, name }) => ({ value: id, label: name }));
  return choices;
}

/** What may be named, where paths may be too. */
function suggestionsOf(): Record<string, Suggestion[]> {
  const sent = (wanted: string) =>
    (uploads.value ?? []).filter(({ kind }) => kind === wanted).map(({ id, name }) => ({ value: id, label: name }));
  return {
    scene: sent("mesh"),
    "light.map": sent("map"),
    "light.stream": (streams.value ?? []).map(({ name, state }) => ({ value: name, label: state })),
    "light.field": (lightFields.value ?? []).map(({ name, streams: members }) => ({ value: name, label: members.join(", ") })),
    "light.grid": (grids.value ?? []).map(({ id, capture }) => ({ value: id, label: capture })),
  };
}

/** The picture's camera as one of a path: both are in world metres, +Z up. */
const ROW_SOURCES = {
  "camera.path": {
    label: "Add what is shown now",
    make: () => (shownCamera.value === null ? null : rowOfCamera(shownCamera.value())),
  },
};

/** A new job: kind, settings, what it would need, and off. */
export function JobForm() {
  const value = form.value;
  useEffect(() => {
    void refreshCaptures();
    void refreshResults();
  }, []);
  if (value === null) return null;
  const fields = fieldsOfKind(value.kind);
  const kind = kinds.value?.find(({ name }) => name === value.kind);
  const need = value.estimate;
  return (
    <form
      class="card new"
      aria-label="New job"
      onSubmit={(event) => {
        event.preventDefault();
        void submitForm();
      }}
    >
      <div class="field">
        <label for="job-kind">Kind</label>
        <select
          id="job-kind"
          value={value.kind}
          onChange={(event) => note({ kind: event.currentTarget.value, draft: {}, errors: [], problem: "", estimate: null })}
        >
          {(kinds.value ?? []).map(({ name }) => (
            <option key={name} value={name}>
              {kindTitle(name)} ({name})
            </option>
          ))}
        </select>
        <p class="hint">{kind?.description}</p>
      </div>
      <SchemaForm
        fields={fields}
        basic={basicOf(value.kind, fields)}
        draft={value.draft}
        errors={value.errors}
        choices={choicesOf()}
        suggestions={suggestionsOf()}
        rowSources={ROW_SOURCES}
        onChange={(draft) => note({ draft, estimate: null })}
      />
      <div class="field">
        <label for="job-order">Queued</label>
        <select
          id="job-order"
          value={String(value.priority)}
          onChange={(event) => note({ priority: Number(event.currentTarget.value) })}
        >
          {ORDERS.map(({ priority, label }) => (
            <option key={priority} value={String(priority)}>
              {label}
            </option>
          ))}
        </select>
      </div>
      <Wrong text={value.problem} />
      {need !== null && (
        <dl class="facts" data-testid="estimate">
          <div>
            <dt>Time, on one core</dt>
            <dd>{duration(need.seconds)}</dd>
          </div>
          <div>
            <dt>Memory, each process</dt>
            <dd>{bytes(need.memory_bytes)}</dd>
          </div>
          <div>
            <dt>Disk</dt>
            <dd>{bytes(need.disk_bytes)}</dd>
          </div>
        </dl>
      )}
      <Wrong text={need?.reason ?? ""} />
      <div class="buttons">
        <button type="submit" class="primary" disabled={value.busy || value.kind === "" || (need !== null && !need.fits)}>
          Submit
        </button>
        {need === null && (
          <button type="button" disabled={value.busy || value.kind === ""} onClick={() => void estimate()}>
            What will it take?
          </button>
        )}
        <button type="button" onClick={closeForm}>
          Close
        </button>
      </div>
    </form>
  );
}
