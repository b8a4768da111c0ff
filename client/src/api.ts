// How the page speaks to the REST interface: addresses, the page's token, and errors in the server's own words.

/** An address under the API, beside the page; the page's token goes along. */
export function apiUrl(base: string, path: string): URL {
  const url = new URL(`api/v1/${path}`, base);
  const token = new URL(base).searchParams.get("token");
  if (token !== null) url.searchParams.set("token", token);
  return url;
}

/** An address for the page's own base, for images, links and event streams. */
export function here(path: string): string {
  return apiUrl(document.baseURI, path).href;
}

export interface FieldError {
  /** Dotted path, such as `settings.bands`. */
  field: string;
  message: string;
}

/** A request that did not work: the message is a sentence for people. */
export class ApiError extends Error {
  constructor(
    message: string,
    /** HTTP status; 0 where the server did not answer. */
    readonly status: number,
    readonly fields: readonly FieldError[] = [],
  ) {
    super(message);
  }
}

interface Problem {
  detail?: string;
  title?: string;
  errors?: FieldError[];
}

/** The error that a problem document (RFC 9457) stands for. */
export function problemError(status: number, body: unknown): ApiError {
  const problem = (typeof body === "object" && body !== null ? body : {}) as Problem;
  const words = problem.detail ?? problem.title ?? `The server answered ${status}.`;
  return new ApiError(words[0]!.toUpperCase() + words.slice(1), status, problem.errors ?? []);
}

export interface RequestOptions {
  method?: "GET" | "POST" | "PATCH" | "DELETE";
  /** Sent as JSON. */
  body?: unknown;
  headers?: Record<string, string>;
  timeoutMs?: number;
  base?: string;
}

const TIMEOUT_MS = 20_000;

/** Send a request; raises `ApiError` with the reason in words. */
export async function send(path: string, options: RequestOptions = {}): Promise<Response> {
  const { method = "GET", body, headers = {}, timeoutMs = TIMEOUT_MS, base = document.baseURI } = options;
  let response: Response;
  try {
    response = await fetch(apiUrl(base, path), {
      method,
      headers: body === undefined ? headers : { "Content-Type": "application/json", ...headers },
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
      signal: AbortSignal.timeout(timeoutMs),
    });
  } catch {
    throw new ApiError("The server does not answer.", 0);
  }
  if (!response.ok) throw problemError(response.status, await response.json().catch(() => null));
  return response;
}

/** The JSON that a request is answered with. */
export async function ask<T>(path: string, options: RequestOptions = {}): Promise<T> {
  const response = await send(path, options);
  return (response.status === 204 ? undefined : await response.json()) as T;
}

/** What to say of an error, whatever it is. */
export function words(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
