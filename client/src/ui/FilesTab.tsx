import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

import { here, words } from "../api.ts";
import { nowMs } from "../clock.ts";
import { ACCEPTED } from "../files.ts";
import { draftOf, openForm } from "../jobs/form.ts";
import { jobs, isFinished } from "../jobs/store.ts";
import { ago, bytes, count } from "../jobs/words.ts";
import { deleteUpload, type Job, type StreamDescription, type Upload } from "../rest.ts";
import { refreshResults, transfers, uploads, uploadsProblem } from "../results.ts";
import { chooseStream, refreshStreams, streams } from "../session.ts";
import { ON_A_TABLE, streamOf, takeFiles } from "../uploads.ts";
import { change, isOfStream, view } from "../view.ts";
import { ConfirmButton, Nothing, Wrong } from "./controls.tsx";
import { FileButton } from "./FileButton.tsx";

/** What needs a file, or was made of it. */
interface Uses {
  streams: StreamDescription[];
  unfinished: Job[];
  /** Finished transfers, newest first. */
  objects: Job[];
}

function usesOf({ id, source }: Upload): Uses {
  const takes = ({ settings }: Job) => settings["mesh"] === id;
  return {
    streams: (streams.value ?? []).filter(({ settings }) => source !== null && settings.source === source),
    unfinished: (jobs.value ?? []).filter((job) => takes(job) && !isFinished(job)),
    objects: transfers.value.filter(takes),
  };
}

function contentsWords({ kind, width, height, vertices, triangles, objects }: Upload): string {
  if (kind === "map") return `${width} × ${height} pixels`;
  const meshes = objects?.length ?? 1;
  return `${meshes > 1 ? `${meshes} meshes, ` : ""}${count(vertices ?? 0)} vertices, ${count(triangles ?? 0)} triangles`;
}

function usedWords({ streams: shown, unfinished, objects }: Uses): string {
  const parts = [
    ...shown.map(({ name }) => `stream ${name}`),
    ...unfinished.map(({ state }) => `job ${state}`),
    ...(objects.length > 0 ? [objects.length === 1 ? "object with shadows" : `${objects.length} objects with shadows`] : []),
  ];
  return parts.length > 0 ? `Used: ${parts.join(", ")}` : "Not used";
}

function FileCard({ upload }: { upload: Upload }) {
  const problem = useSignal("");
  const uses = usesOf(upload);
  const newest = uses.objects[0];
  const [stream] = uses.streams;
  const { object, stream: followed, light } = view.value;
  const isShown = upload.kind === "mesh" ? uses.objects.some(({ id }) => id === object) : followed === stream?.name && isOfStream(light);
  const attempt = (work: () => Promise<unknown>) => {
    problem.value = "";
    work().catch((error: unknown) => (problem.value = words(error)));
  };
  const follow = async () => {
    const name = await streamOf(upload);
    await refreshStreams();
    chooseStream(name);
    change({ light: "stream" });
  };
  const compute = () => {
    const before = (uses.unfinished[0] ?? newest)?.settings ?? ON_A_TABLE;
    void openForm("prt-transfer", { ...draftOf(before), mesh: upload.id });
  };
  return (
    <article class={isShown ? "card chosen" : "card"} aria-label={upload.name} data-testid="file">
      <header>
        <h3 title={upload.name}>{upload.name}</h3>
        <span class={`badge ${isShown ? "good" : "quiet"}`}>{isShown ? "in the picture" : upload.kind}</span>
      </header>
      <p class="muted">
        {contentsWords(upload)} ·{" "}
        <a href={here(`uploads/${upload.id}/file`)} download={upload.name} title="Download it">
          {bytes(upload.bytes)}
        </a>{" "}
        · {ago(upload.created, nowMs())}
        <br />
        {usedWords(uses)}
      </p>
      <Wrong text={problem.value} />
      <div class="buttons">
        {upload.kind === "mesh" && newest !== undefined && !isShown && (
          <button type="button" class="primary" onClick={() => change({ object: newest.id, shadows: true })}>
            Show
          </button>
        )}
        {upload.kind === "mesh" && (
          <button type="button" class={newest === undefined ? "primary" : ""} onClick={compute}>
            {newest === undefined ? "Compute shadows…" : "Other settings…"}
          </button>
        )}
        {upload.kind === "map" && !isShown && (
          <button type="button" class="primary" onClick={() => attempt(follow)}>
            {stream === undefined ? "Make it a stream" : "Follow"}
          </button>
        )}
        <ConfirmButton
          label="Delete"
          question={uses.objects.length > 0 ? "Delete the file? Its objects stay" : "Delete the file?"}
          onConfirm={() =>
            attempt(async () => {
              await deleteUpload(upload.id);
              await refreshResults();
            })
          }
        />
      </div>
    </article>
  );
}

/** Meshes and maps that were sent to the server. */
export function FilesTab() {
  useEffect(() => void refreshResults(), []);
  const list = uploads.value;
  return (
    <div class="list">
      <FileButton accept={ACCEPTED} onFiles={takeFiles}>
        Add a mesh or a map…
      </FileButton>
      <Wrong text={uploadsProblem.value} />
      {list === null && uploadsProblem.value === "" && <p class="muted">Asking the server…</p>}
      {list?.length === 0 && (
        <Nothing title="No files yet">
          <p>
            Drop a mesh (GLB, OBJ, PLY) onto the page to see it lit with its own shadows, or a lat-long map (EXR, HDR) to have its
            light. What you send is kept here.
          </p>
        </Nothing>
      )}
      {list?.map((upload) => (
        <FileCard key={upload.id} upload={upload} />
      ))}
    </div>
  );
}
