// Files that the server serves as they are: chunks of grids, results of jobs.

/** Fetch a file. Raises `Error` with the reason in words, or the signal's own error where it was aborted. */
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
  throw new Error(problem.detail ?? `${url.pathname}: the server answered ${response.status}.`);
}
