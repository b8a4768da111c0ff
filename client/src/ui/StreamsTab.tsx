import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

import { ApiError, words, type FieldError } from "../api.ts";
import { otherComplaints, patchOf, settingsOf, type Draft, type Field } from "../jobs/schema.ts";
import { changeStream, createStream, deleteStream, getStream, type StreamDescription } from "../rest.ts";
import { chooseStream, refreshStreams, snapshot, streams } from "../session.ts";
import { streamFields } from "../streams.ts";
import { change, view } from "../view.ts";
import { FieldsSection } from "./FieldsSection.tsx";
import { Health } from "./Health.tsx";
import { LatencyGraph } from "./LatencyGraph.tsx";
import { SchemaForm } from "./SchemaForm.tsx";
import { ConfirmButton, Meter, Nothing, Section, Wrong } from "./controls.tsx";

const BASIC = ["source", "mapping.kind", "filter.tau_seconds", "window.kind", "position_m", "gradients.proxy", "enabled"];
/** What a proxy of the surroundings needs beside its name. */
const PROXY_FIELDS: Record<string, string[]> = {
  sphere: ["gradients.radius_m", "gradients.centre_m"],
  box: ["gradients.box_lower_m", "gradients.box_upper_m"],
  mesh: ["gradients.mesh", "gradients.mesh_up"],
  depth: ["gradients.depth"],
};
const TONES: Record<string, string> = {
  running: "good",
  starting: "busy",
  stalled: "busy",
  failed: "bad",
  ended: "quiet",
  stopped: "quiet",
};
const SOURCES: [string, string][] = [
  ["synthetic:room", "a room with moving lights, no camera needed"],
  ["exr:/data/probe.*.exr?fps=30&loop=1", "a recorded sequence"],
  ["video:/data/probe.mp4", "a video file"],
];

function ageWords(stream: StreamDescription): string {
  const age = stream.last_frame_age_seconds;
  if (age === null) return "no frame yet";
  return age < 2 ? `${stream.fps.toFixed(1)} fps` : `last frame ${age.toFixed(0)} s ago`;
}

function countsOf(stream: StreamDescription): [string, string][] {
  const facts: [string, string][] = [["Frames", String(stream.frames_received)]];
  const lost = [
    ...(stream.frames_skipped > 0 ? [`${stream.frames_skipped} unreadable`] : []),
    ...(stream.frames_dropped > 0 ? [`${stream.frames_dropped} overtaken`] : []),
  ];
  if (lost.length > 0) facts.push(["Lost", lost.join(", ")]);
  if ((stream.worker?.restarts ?? 0) > 0) facts.push(["Restarts", String(stream.worker!.restarts)]);
  const now = snapshot.value;
  if (view.value.stream === stream.name && now !== null) {
    if (now.latencyMs !== null) facts.push(["Latency", `${now.latencyMs.toFixed(1)} ms`]);
    facts.push(["Missed by this page", String(now.missed)]);
  }
  facts.push(["Followers", String(stream.subscribers)]);
  return facts;
}

/** Settings of a stream that is there, or of a new one. */
function Editor({ stream, onClose }: { stream: StreamDescription | null; onClose: () => void }) {
  const fields = useSignal<Field[] | null>(null);
  const draft = useSignal<Draft>({});
  const name = useSignal("");
  const etag = useSignal("*");
  const errors = useSignal<readonly FieldError[]>([]);
  const problem = useSignal("");
  const busy = useSignal(false);
  const settings = useSignal(stream?.settings ?? {});
  const failed = (error: unknown) => {
    errors.value = error instanceof ApiError ? error.fields : [];
    const isOfFields = errors.value.some(({ field }) => field !== "name");
    problem.value = isOfFields ? otherComplaints(fields.value ?? [], errors.value) : words(error);
  };
  useEffect(() => {
    streamFields().then((found) => (fields.value = found), failed);
    if (stream === null) return;
    getStream(stream.name).then((found) => {
      etag.value = found.etag;
      settings.value = found.stream.settings;
    }, failed);
  }, []);
  if (fields.value === null) return problem.value === "" ? <Meter label="Asking" share={null} /> : <Wrong text={problem.value} />;
  const shown = stream === null ? fields.value : withValues(fields.value, settings.value);
  const proxyField = shown.find(({ path }) => path === "gradients.proxy");
  const proxy = String(draft.value["gradients.proxy"] ?? proxyField?.fallback ?? "none");
  const basic = BASIC.flatMap((path) => (path === "gradients.proxy" ? [path, ...(PROXY_FIELDS[proxy] ?? [])] : [path]));
  const submit = (event: Event) => {
    event.preventDefault();
    busy.value = true;
    problem.value = "";
    errors.value = [];
    const work = async () => {
      if (stream === null) {
        const made = await createStream(name.value.trim(), settingsOf(fields.value!, draft.value));
        chooseStream(made.name);
      } else {
        const patch = patchOf(fields.value!, draft.value, settings.value);
        if (Object.keys(patch).length > 0) await changeStream(stream.name, patch, etag.value);
      }
      await refreshStreams();
      onClose();
    };
    work()
      .catch(failed)
      .finally(() => (busy.value = false));
  };
  return (
    <form class="form" aria-label={stream === null ? "New stream" : `Settings of ${stream.name}`} onSubmit={submit}>
      {stream === null && (
        <div class="field">
          <label for="stream-name">Name</label>
          <input
            id="stream-name"
            type="text"
            required
            autocomplete="off"
            spellcheck={false}
            value={name.value}
            onInput={(event) => (name.value = event.currentTarget.value)}
          />
          <p class="hint">Lower-case letters, digits, - and _</p>
        </div>
      )}
      {stream === null && (
        <div class="examples">
          <p class="hint">Sources, for example (click to take one):</p>
          {SOURCES.map(([source, meaning]) => (
            <button key={source} type="button" class="link" onClick={() => (draft.value = { ...draft.value, source })}>
              <code>{source}</code> <small>{meaning}</small>
            </button>
          ))}
        </div>
      )}
      <SchemaForm fields={shown} basic={basic} draft={draft.value} errors={errors.value} onChange={(next) => (draft.value = next)} />
      <Wrong text={problem.value} />
      <div class="buttons">
        <button type="submit" class="primary" disabled={busy.value}>
          {stream === null ? "Add" : "Save"}
        </button>
        <button type="button" onClick={onClose}>
          Close
        </button>
      </div>
    </form>
  );
}

/** What holds now, in place of the defaults. */
function withValues(fields: readonly Field[], settings: StreamDescription["settings"] | Record<string, never>): Field[] {
  return fields.map((field) => {
    let value: unknown = settings;
    for (const key of field.path.split(".")) value = (value as Record<string, unknown> | null | undefined)?.[key];
    return value === undefined ? field : { ...field, fallback: value as NonNullable<Field["fallback"]> };
  });
}

function StreamCard({ stream }: { stream: StreamDescription }) {
  const editing = useSignal(false);
  const problem = useSignal("");
  const isFollowed = view.value.stream === stream.name;
  const remove = () => {
    deleteStream(stream.name)
      .then(async () => {
        await refreshStreams();
        // What is left takes its place.
        if (isFollowed && !streams.value?.some(({ name }) => name === stream.name)) change({ stream: null });
      })
      .catch((error: unknown) => (problem.value = words(error)));
  };
  const source = stream.settings.source;
  return (
    <article class={isFollowed ? "card chosen" : "card"} aria-label={stream.name} data-testid="stream" data-state={stream.state}>
      <header>
        <h3>
          {stream.name} <small>{ageWords(stream)}</small>
        </h3>
        <span class={`badge ${TONES[stream.state] ?? "quiet"}`}>{stream.state}</span>
      </header>
      <p class="muted path" title={source}>
        {source}
      </p>
      {stream.last_error !== "" && <p class="last-error">{stream.last_error}</p>}
      <Wrong text={problem.value} />
      <div class="buttons">
        {!isFollowed && (
          <button type="button" class="primary" onClick={() => chooseStream(stream.name)}>
            Follow
          </button>
        )}
        <button type="button" aria-expanded={editing.value} onClick={() => (editing.value = !editing.value)}>
          Edit
        </button>
        {stream.origin !== "worker" && (
          <ConfirmButton
            label="Remove"
            question={stream.origin === "api" ? "Remove it for good?" : "Remove it?"}
            onConfirm={remove}
          />
        )}
      </div>
      {editing.value ? (
        <Editor stream={stream} onClose={() => (editing.value = false)} />
      ) : (
        <details>
          <summary>Counts</summary>
          <dl class="facts">
            {countsOf(stream).map(([name, value]) => (
              <div key={name}>
                <dt>{name}</dt>
                <dd>{value}</dd>
              </div>
            ))}
          </dl>
        </details>
      )}
    </article>
  );
}

/** Sources of live light. */
export function StreamsTab() {
  const adding = useSignal(false);
  const list = streams.value;
  return (
    <div class="list">
      {adding.value ? (
        <div class="card">
          <Editor stream={null} onClose={() => (adding.value = false)} />
        </div>
      ) : (
        <button type="button" class="primary" onClick={() => (adding.value = true)}>
          Add a stream…
        </button>
      )}
      {list?.length === 0 && (
        <Nothing title="No streams yet">
          <p>A stream turns pictures of a light probe into light, live. Add one, or drop an EXR or HDR map onto the page.</p>
        </Nothing>
      )}
      {list?.map((stream) => (
        <StreamCard key={stream.name} stream={stream} />
      ))}
      {(list?.length ?? 0) > 0 && <FieldsSection />}
      <Section title="Latency" aside="ms, capture to page">
        <LatencyGraph />
      </Section>
      <Section title="Newest frame">
        <Health />
      </Section>
    </div>
  );
}
