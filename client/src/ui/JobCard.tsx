import { useSignal } from "@preact/signals";

import { here, words } from "../api.ts";
import { refreshCaptures } from "../captures.ts";
import { nowMs } from "../clock.ts";
import { NORMAL_PRIORITY } from "../jobs/form.ts";
import { cancel, remove, retry, isFinished } from "../jobs/store.ts";
import { ago, bytes, count, duration, kindTitle, leftWords, stageWords } from "../jobs/words.ts";
import { jobLog, registerCapture, type Job, type JobState, type LogLine } from "../rest.ts";
import { subjectOf } from "../results.ts";
import { change } from "../view.ts";
import { showPicture } from "./PictureDialog.tsx";
import { ConfirmButton, Meter, Wrong } from "./controls.tsx";

const TONES: Record<JobState, string> = {
  queued: "quiet",
  running: "busy",
  cancelling: "busy",
  cancelled: "quiet",
  failed: "bad",
  succeeded: "good",
};
const GRID = ".zarr";

/** The stage, and how fast it goes. */
function progressWords(job: Job): string {
  const progress = job.progress;
  if (progress === null) {
    if (job.state !== "queued") return "starts";
    const order = Math.sign(job.priority - NORMAL_PRIORITY);
    return order === 0 ? "waits for its turn" : `waits, ${order < 0 ? "before" : "after"} others`;
  }
  const parts = [`${stageWords(progress.stage)} ${count(progress.done)} of ${count(progress.total)}`];
  if (progress.rate > 0) parts.push(`${count(progress.rate)}/s`);
  return [...parts, leftWords(progress)].filter((part) => part !== "").join(" · ");
}

function whenWords(job: Job): string {
  if (job.finished === null || job.started === null) return ago(job.created, nowMs());
  return `${ago(job.finished, nowMs())}, took ${duration((job.finished - job.started) / 1e9)}`;
}

function lineWords({ type, time_ns, level, message, state, error, ...rest }: LogLine): string {
  const time = new Date(time_ns / 1e6).toTimeString().slice(0, 8);
  const said = type === "log" ? `${level === "info" ? "" : `${String(level)}: `}${String(message)}` : String(state);
  const details = Object.entries(rest).map(([key, value]) => `${key}=${typeof value === "object" ? JSON.stringify(value) : String(value)}`);
  return [time, said, ...(error === undefined ? [] : [String(error)]), ...details].join(" ");
}

/** An address that is another one when the picture is: the page would not ask again for the same. */
function withVersion(address: string, version: number): string {
  const url = new URL(address);
  url.searchParams.set("drawn", String(version));
  return url.href;
}

export function JobCard({ job }: { job: Job }) {
  const problem = useSignal("");
  const log = useSignal<LogLine[] | null>(null);
  const attempt = (work: () => Promise<unknown>) => {
    problem.value = "";
    work().catch((error: unknown) => (problem.value = words(error)));
  };
  const finished = isFinished(job);
  const finishedPicture = job.artifacts.find(({ path }) => path === "preview.png");
  const picture =
    finishedPicture !== undefined
      ? here(`artifacts/${finishedPicture.id}`)
      : job.preview_ns !== null && !finished
        ? withVersion(here(`jobs/${job.id}/preview`), job.preview_ns)
        : null;
  // A rendering's preview is smaller than the picture.
  const whole = job.artifacts.find(({ path }) => path === "picture.png");
  const film = job.artifacts.find(({ path }) => path === "film.mp4");
  const grids = job.artifacts.filter(({ path }) => path.endsWith(GRID));
  const hasObject = job.kind === "prt-transfer" && job.state === "succeeded";
  const makesCapture = job.kind === "capture-reduce" ? job.artifacts.find(({ media_type }) => media_type === "inode/directory") : undefined;
  const subject = subjectOf(job);
  const title = `${kindTitle(job.kind)} ${subject}`;
  return (
    <article class="card" aria-label={title} data-testid="job" data-state={job.state}>
      <header>
        <h3 title={title}>
          {kindTitle(job.kind)} <small>{subject}</small>
        </h3>
        <span class={`badge ${TONES[job.state]}`}>{job.state}</span>
      </header>
      <p class="muted" title={`Job ${job.id}, ${job.kind}${job.attempts > 1 ? `, attempt ${job.attempts}` : ""}`}>
        {finished ? whenWords(job) : progressWords(job)}
      </p>
      {!finished && (
        <Meter
          label={title}
          share={job.progress === null || job.progress.total <= 0 ? (job.state === "queued" ? 0 : null) : job.progress.done / job.progress.total}
        />
      )}
      {job.error !== null && <Wrong text={job.error} />}
      <Wrong text={problem.value} />
      {picture !== null && (
        <button
          type="button"
          class="picture"
          aria-label={`Preview of ${title}, larger`}
          title={finished ? undefined : "What there is so far"}
          onClick={() => showPicture(title, whole === undefined ? picture : here(`artifacts/${whole.id}`))}
        >
          <img src={picture} alt="" loading="lazy" />
        </button>
      )}
      <div class="buttons">
        {grids.map((grid) => (
          <button
            key={grid.id}
            type="button"
            class="primary"
            onClick={() => change({ grid: grid.id, light: "grid", at: null, camera: null, tab: "scene" })}
          >
            {grids.length === 1 ? "Open the grid" : `Open ${grid.path.slice(0, -GRID.length)}`}
          </button>
        ))}
        {film !== undefined && (
          <button type="button" class="primary" onClick={() => window.open(here(`artifacts/${film.id}`), "_blank", "noreferrer")}>
            Open the film
          </button>
        )}
        {hasObject && (
          <button type="button" class="primary" onClick={() => change({ object: job.id, shadows: true })}>
            Show the object
          </button>
        )}
        {makesCapture !== undefined && (
          <button
            type="button"
            onClick={() =>
              attempt(async () => {
                await registerCapture(`jobs/${job.id}/artifacts/${makesCapture.path}`, `reduced-${job.id.slice(0, 6)}`);
                await refreshCaptures();
                change({ tab: "captures" });
              })
            }
          >
            Use as a capture
          </button>
        )}
        {(job.state === "queued" || job.state === "running") && (
          <button type="button" onClick={() => attempt(() => cancel(job.id))}>
            Cancel
          </button>
        )}
        {(job.state === "failed" || job.state === "cancelled") && (
          <button type="button" onClick={() => attempt(() => retry(job.id))}>
            Retry
          </button>
        )}
        {finished && <ConfirmButton label="Delete" question="Delete it and its results?" onConfirm={() => attempt(() => remove(job.id))} />}
      </div>
      {job.artifacts.length > 0 && (
        <details>
          <summary>Results ({job.artifacts.length})</summary>
          <ul class="files">
            {job.artifacts.map((artifact) => (
              <li key={artifact.id}>
                <a href={here(`artifacts/${artifact.id}`)} target="_blank" rel="noreferrer" title={`SHA-256 ${artifact.sha256}`}>
                  {artifact.path}
                </a>
                <small>{bytes(artifact.bytes)}</small>
              </li>
            ))}
          </ul>
        </details>
      )}
      <details
        onToggle={(event) => {
          if (event.currentTarget.open) attempt(async () => (log.value = await jobLog(job.id)));
        }}
      >
        <summary>Log</summary>
        <pre class="log" tabIndex={0}>
          {log.value === null ? "…" : log.value.length === 0 ? "nothing yet" : log.value.map(lineWords).join("\n")}
        </pre>
      </details>
      <details>
        <summary>Settings</summary>
        <pre class="log" tabIndex={0}>
          {JSON.stringify(job.settings, null, 1)}
        </pre>
      </details>
    </article>
  );
}
