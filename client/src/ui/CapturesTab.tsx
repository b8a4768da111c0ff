import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

import { here, words } from "../api.ts";
import { captures, capturesProblem, refreshCaptures } from "../captures.ts";
import { openForm } from "../jobs/form.ts";
import { point } from "../jobs/words.ts";
import { forgetCapture, registerCapture, type Capture } from "../rest.ts";
import { showPicture } from "./PictureDialog.tsx";
import { Command, ConfirmButton, Nothing, Wrong } from "./controls.tsx";

function factsOf(capture: Capture): [string, string][] {
  const facts: [string, string][] = [["Frames", `${capture.width} × ${capture.height}, ${capture.mapping}`]];
  if (capture.bounds_m !== null) {
    facts.push(["From", `${point(capture.bounds_m[0])} m`], ["To", `${point(capture.bounds_m[1])} m`]);
  }
  const words = [
    capture.rotating ? "a rig that turns" : "a rig that does not turn",
    ...(capture.simulated ? ["simulated, its exact light is known"] : []),
    ...(capture.sorted ? ["sorted"] : []),
  ];
  facts.push(["Kind", words.join("; ")]);
  return facts;
}

function CaptureCard({ capture }: { capture: Capture }) {
  const problem = useSignal("");
  const forget = () => {
    forgetCapture(capture.id)
      .then(refreshCaptures)
      .catch((error: unknown) => (problem.value = words(error)));
  };
  const plot = here(`captures/${encodeURIComponent(capture.id)}/plot`);
  const open = useSignal(false);
  return (
    <article class="card" aria-label={capture.id} data-testid="capture">
      <header>
        <h3>{capture.id}</h3>
        <span class={`badge ${capture.valid ? "good" : "bad"}`}>{capture.valid ? `${capture.probes} probes` : "unusable"}</span>
      </header>
      <p class="muted path" title={capture.path}>
        {capture.path}
      </p>
      <Wrong text={capture.error ?? ""} />
      <Wrong text={problem.value} />
      <div class="buttons">
        {capture.valid && (
          <button type="button" class="primary" onClick={() => void openForm("ilf-grid", { capture: capture.id })}>
            Make a grid…
          </button>
        )}
        <ConfirmButton label="Forget" question="Forget it? Its folder stays" onConfirm={forget} />
      </div>
      {capture.valid && (
        <details onToggle={(event) => (open.value = event.currentTarget.open)}>
          <summary>Look into it</summary>
          <div class="stack">
          <dl class="facts">
            {factsOf(capture).map(([name, value]) => (
              <div key={name}>
                <dt>{name}</dt>
                <dd>{value}</dd>
              </div>
            ))}
          </dl>
          {open.value && (
            <button
              type="button"
              class="picture"
              aria-label={`Where the probes of ${capture.id} stand, larger`}
              onClick={() => showPicture(`Probes of ${capture.id}`, plot)}
            >
              <img src={plot} alt="Where the probes stand, from above and from two sides" />
            </button>
          )}
          </div>
        </details>
      )}
    </article>
  );
}

function Register() {
  const path = useSignal("");
  const id = useSignal("");
  const problem = useSignal("");
  const submit = (event: Event) => {
    event.preventDefault();
    problem.value = "";
    registerCapture(path.value.trim(), id.value.trim() || null)
      .then(async () => {
        path.value = id.value = "";
        await refreshCaptures();
      })
      .catch((error: unknown) => (problem.value = words(error)));
  };
  return (
    <details class="card">
      <summary>Register a capture</summary>
      <form class="form" onSubmit={submit}>
        <div class="field">
          <label for="capture-path">Folder</label>
          <input
            id="capture-path"
            type="text"
            required
            autocomplete="off"
            spellcheck={false}
            placeholder="captures/stage"
            value={path.value}
            onInput={(event) => (path.value = event.currentTarget.value)}
          />
          <p class="hint">On the server, below its data folder&apos;s captures/ or one of [jobs] data_roots</p>
        </div>
        <div class="field">
          <label for="capture-id">Name</label>
          <input
            id="capture-id"
            type="text"
            autocomplete="off"
            spellcheck={false}
            placeholder="the folder’s name"
            value={id.value}
            onInput={(event) => (id.value = event.currentTarget.value)}
          />
          <p class="hint">Lower-case letters, digits, - and _</p>
        </div>
        <Wrong text={problem.value} />
        <div class="buttons">
          <button type="submit" class="primary">
            Register
          </button>
        </div>
      </form>
    </details>
  );
}

/** Sequences of probes with poses. */
export function CapturesTab() {
  useEffect(() => void refreshCaptures(), []);
  const list = captures.value;
  return (
    <div class="list">
      <Wrong text={capturesProblem.value} />
      {list === null && capturesProblem.value === "" && <p class="muted">Asking the server…</p>}
      {list?.length === 0 && (
        <Nothing title="No captures yet">
          <p>A capture is a folder of probe pictures with the place of each. This one is simulated, to try it out:</p>
          <Command line="lightwell capture simulate data/captures/room --probes 300" />
          <p>Then register it below.</p>
        </Nothing>
      )}
      {list?.map((capture) => (
        <CaptureCard key={capture.id} capture={capture} />
      ))}
      <Register />
    </div>
  );
}
