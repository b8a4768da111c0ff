import { useSignal } from "@preact/signals";

import { ApiError, words, type FieldError } from "../api.ts";
import { createField, deleteField, changeField, type FieldDescription } from "../rest.ts";
import { fields, fieldsProblem, refreshStreams, streams } from "../session.ts";
import { change, view } from "../view.ts";
import { ConfirmButton, Section, Wrong } from "./controls.tsx";

/** Light everything with a field. */
function follow(name: string): void {
  const before = view.peek();
  change({ light: "field", field: name, at: null, camera: before.light === "field" ? before.camera : null });
}

/** A new field, or another choice of streams for one that is there. */
function Editor({ field, onClose }: { field: FieldDescription | null; onClose: () => void }) {
  const name = useSignal("");
  const chosen = useSignal<readonly string[]>(field?.streams ?? []);
  const problem = useSignal("");
  const busy = useSignal(false);
  // A stream that is gone can still be taken out.
  const names = [...new Set([...(streams.value ?? []).map((stream) => stream.name), ...chosen.value])];
  const placed = new Map((streams.value ?? []).map((stream) => [stream.name, stream.settings["position_m"] != null]));
  const submit = (event: Event) => {
    event.preventDefault();
    busy.value = true;
    problem.value = "";
    const work = async () => {
      const made = field === null ? await createField(name.value.trim(), chosen.value) : await changeField(field.name, chosen.value);
      await refreshStreams();
      if (field === null) follow(made.name);
      onClose();
    };
    work()
      .catch((error: unknown) => (problem.value = complaint(error)))
      .finally(() => (busy.value = false));
  };
  return (
    <form class="form" aria-label={field === null ? "New field" : `Streams of ${field.name}`} onSubmit={submit}>
      {field === null && (
        <div class="field">
          <label for="field-name">Name</label>
          <input
            id="field-name"
            type="text"
            required
            autocomplete="off"
            spellcheck={false}
            value={name.value}
            onInput={(event) => (name.value = event.currentTarget.value)}
          />
        </div>
      )}
      {names.map((stream) => (
        <label class="toggle" key={stream} title={placed.get(stream) === true ? "" : "Its settings do not say where its probe stands: position_m"}>
          <span class="label">
            {stream}
            {placed.get(stream) !== true && <small> place unknown</small>}
          </span>
          <input
            type="checkbox"
            checked={chosen.value.includes(stream)}
            onChange={(event) => {
              const others = chosen.value.filter((item) => item !== stream);
              chosen.value = event.currentTarget.checked ? [...others, stream] : others;
            }}
          />
        </label>
      ))}
      <Wrong text={problem.value} />
      <div class="buttons">
        <button type="submit" class="primary" disabled={busy.value || chosen.value.length === 0}>
          {field === null ? "Make the field" : "Save"}
        </button>
        <button type="button" onClick={onClose}>
          Close
        </button>
      </div>
    </form>
  );
}

function complaint(error: unknown): string {
  const found: readonly FieldError[] = error instanceof ApiError ? error.fields : [];
  return found.length > 0 ? found.map(({ field, message }) => `${field}: ${message}`).join("; ") : words(error);
}

function FieldCard({ field }: { field: FieldDescription }) {
  const editing = useSignal(false);
  const problem = useSignal("");
  const { light, field: chosen } = view.value;
  const isShown = light === "field" && chosen === field.name;
  const used = field.members.filter((member) => member.used).length;
  const remove = () => {
    deleteField(field.name)
      .then(async () => {
        await refreshStreams();
        if (isShown && !fields.value?.some(({ name }) => name === field.name)) change({ light: "stream", field: null, camera: null });
      })
      .catch((error: unknown) => (problem.value = words(error)));
  };
  return (
    <article class={isShown ? "card chosen" : "card"} aria-label={field.name} data-testid="field">
      <header>
        <h3>{field.name}</h3>
        <span class={`badge ${used === field.members.length ? "good" : used > 0 ? "busy" : "bad"}`}>{`${used} of ${field.members.length}`}</span>
      </header>
      <p class="muted">{field.streams.join(", ")}</p>
      {field.members.map(({ stream, problem }) => problem !== "" && <p class="last-error" key={stream}>{`${stream}: ${problem}`}</p>)}
      <Wrong text={problem.value} />
      <div class="buttons">
        {!isShown && (
          <button type="button" class="primary" onClick={() => follow(field.name)}>
            Light with it
          </button>
        )}
        <button type="button" aria-expanded={editing.value} onClick={() => (editing.value = !editing.value)}>
          Edit
        </button>
        {field.origin === "api" && <ConfirmButton label="Remove" question="Remove it for good?" onConfirm={remove} />}
      </div>
      {editing.value && <Editor field={field} onClose={() => (editing.value = false)} />}
    </article>
  );
}

/** Streams whose probes stand at known places, combined: the light between them. */
export function FieldsSection() {
  const adding = useSignal(false);
  const list = fields.value ?? [];
  return (
    <Section title="Fields" aside="several probes, one light">
      {list.map((field) => (
        <FieldCard key={field.name} field={field} />
      ))}
      <Wrong text={fieldsProblem.value} />
      {adding.value ? (
        <div class="card">
          <Editor field={null} onClose={() => (adding.value = false)} />
        </div>
      ) : (
        <>
          <p class="hint">Streams whose probes stand at known places light what is between them.</p>
          <button type="button" onClick={() => (adding.value = true)}>
            Make a field…
          </button>
        </>
      )}
    </Section>
  );
}
