// Files that the server serves as they are: chunks of grids, results of jobs.

/** The server has no such file. */
export class NotThere extends Error {}

/** Fetch a file. Raises `NotThere` where there is none, else `Error` with the reason in words, or the signal's own error where it was aborted. */
export async function download(url: URL, signal: AbortSignal): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(url, { signal });
  } catch (error) {
    if (signal.aborted) throw error;
    throw new Error("The server does not answer.");
  }
  if (response.ok) return response;
  const problem = (await response.json().catch(() => ({}))) as { detail?: string };
  const words = problem.detail ?? `${url.pathname}: the server answered ${response.status}.`;
  throw response.status === 404 ? new NotThere(words) : new Error(words);
}
