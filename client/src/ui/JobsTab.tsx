import { form, openForm } from "../jobs/form.ts";
import { hasMore, jobs, jobsProblem, showMore } from "../jobs/store.ts";
import { JobCard } from "./JobCard.tsx";
import { JobForm } from "./JobForm.tsx";
import { Nothing, Wrong } from "./controls.tsx";

/** Long work: what was asked for, how far it is, what came of it. */
export function JobsTab() {
  const list = jobs.value;
  return (
    <div class="list">
      {form.value === null ? (
        <button type="button" class="primary" onClick={() => void openForm()}>
          New job…
        </button>
      ) : (
        <JobForm />
      )}
      <Wrong text={jobsProblem.value} />
      {list?.length === 0 && form.value === null && (
        <Nothing title="No jobs yet">
          <p>
            A job computes what takes longer: a grid of light from a capture, or the shadows of a mesh. Drop a mesh onto the page,
            or start one here.
          </p>
        </Nothing>
      )}
      {list === null && jobsProblem.value === "" && <p class="muted">Asking the server…</p>}
      {list?.map((job) => (
        <JobCard key={job.id} job={job} />
      ))}
      {hasMore.value && (
        <button type="button" onClick={showMore}>
          Older jobs
        </button>
      )}
    </div>
  );
}
