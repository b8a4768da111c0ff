// The part of the REST interface that the page needs.

export interface StreamSummary {
  name: string;
  state: string;
}

/** An address under the API, beside the page; the page's token goes along. */
export function apiUrl(base: string, path: string): URL {
  const url = new URL(`api/v1/${path}`, base);
  const token = new URL(base).searchParams.get("token");
  if (token !== null) url.searchParams.set("token", token);
  return url;
}

/** The streams that the server has; raises `Error` with the reason in words. */
export async function listStreams(base: string): Promise<StreamSummary[]> {
  let response: Response;
  try {
    response = await fetch(apiUrl(base, "streams"), { signal: AbortSignal.timeout(5000) });
  } catch {
    throw new Error("The server does not answer.");
  }
  if (!response.ok) {
    const problem = (await response.json().catch(() => ({}))) as { detail?: string; title?: string };
    throw new Error(problem.detail ?? problem.title ?? `The server answered ${response.status}.`);
  }
  const { streams } = (await response.json()) as { streams: StreamSummary[] };
  return streams;
}
