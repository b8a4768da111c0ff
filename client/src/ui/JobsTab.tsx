import { useEffect } from "preact/hooks";

import { form, openForm } from "../jobs/form.ts";
import { jobs, jobsProblem, kinds, listed, loadKinds, showMore } from "../jobs/store.ts";
import { kindTitle } from "../jobs/words.ts";
import { JOB_STATES, change, view } from "../view.ts";
import { JobCard } from "./JobCard.tsx";
import { JobForm } from "./JobForm.tsx";
import { Nothing, Wrong } from "./controls.tsx";

/** Which of the jobs are listed. */
function Filters() {
  const { jobState, jobKind } = view.value;
  useEffect(() => void loadKinds().catch(() => undefined), []); // the list says what is wrong
  return (
    <div class="filters" role="group" aria-label="Which jobs are listed">
      <select
        aria-label="State"
        value={jobState ?? ""}
        onChange={({ currentTarget: { value } }) => change({ jobState: JOB_STATES.find((name) => name === value) ?? null })}
      >
        <option value="">any state</option>
        {JOB_STATES.map((name) => (
          <option key={name} value={name}>
            {name}
          </option>
        ))}
      </select>
      <select aria-label="Kind of job" value={jobKind ?? ""} onChange={({ currentTarget: { value } }) => change({ jobKind: value || null })}>
        <option value="">any kind</option>
        {(kinds.value ?? []).map(({ name }) => (
          <option key={name} value={name}>
            {kindTitle(name)}
          </option>
        ))}
      </select>
    </div>
  );
}

function Empty({ filtered }: { filtered: boolean }) {
  if (filtered) {
    return (
      <Nothing title="None of these">
        <p>No job is of this state and kind.</p>
        <button type="button" onClick={() => change({ jobState: null, jobKind: null })}>
          List all
        </button>
      </Nothing>
    );
  }
  return (
    <Nothing title="No jobs yet">
      <p>
        A job computes what takes longer: a grid of light from a capture, or the shadows of a mesh. Drop a mesh onto the page, or
        start one here.
      </p>
    </Nothing>
  );
}

/** Long work: what was asked for, how far it is, what came of it. */
export function JobsTab() {
  const listing = listed.value;
  const list = listing.jobs.value;
  const { jobState, jobKind } = view.value;
  const filtered = jobState !== null || jobKind !== null;
  return (
    <div class="list">
      {form.value === null ? (
        <button type="button" class="primary" onClick={() => void openForm()}>
          New job…
        </button>
      ) : (
        <JobForm />
      )}
      {(filtered || (jobs.value?.length ?? 0) > 1) && <Filters />}
      <Wrong text={jobsProblem.value} />
      {list?.length === 0 && form.value === null && <Empty filtered={filtered} />}
      {list === null && jobsProblem.value === "" && <p class="muted">Asking the server…</p>}
      {list?.map((job) => (
        <JobCard key={job.id} job={job} />
      ))}
      {listing.next.value !== null && (
        <button type="button" onClick={() => void showMore()}>
          Older jobs
        </button>
      )}
    </div>
  );
}
