// What the server is asked: JSON, and errors as {what, found, allowed, to_do, key}.

/** @typedef {Partial<import("answers").ErrorFacts> & {what: string}} ErrorFacts */

export class Refused extends Error {
  /**
   * @param {ErrorFacts} facts
   * @param {number} status of the answer, 0 where none came
   * @param {unknown} current what a file holds now, where another version was expected
   */
  constructor(facts, status = 0, current = undefined) {
    super(facts.what);
    this.facts = facts;
    this.status = status;
    this.current = current;
    this.key = facts.key ?? [];
  }

  get text() {
    const { what, found, allowed, to_do } = this.facts;
    return [what, found && `found: ${found}`, allowed && `allowed: ${allowed}`,
      to_do && `to do: ${to_do}`].filter(Boolean)
      .join("; ");
  }
}

export const STARTED_ANEW = 401; // the token of this page is that of a server that has ended

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} [body]
 * @param {Record<string, string>} [headers]
 */
async function asked(method, path, body, headers = {}) {
  const raw = body instanceof Blob;
  /** @type {Record<string, string>} */
  const sent = { ...(body === undefined ? {}
    : { "Content-Type": raw ? "application/octet-stream" : "application/json" }),
    ...(method === "GET" ? {} : { "X-Zerobeam": "1" }), ...headers };
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: sent,
      body: body === undefined || raw ? /** @type {Blob | undefined} */ (body) : JSON.stringify(body),
    });
  } catch {
    throw new Refused({ what: "the server does not answer",
      to_do: "is zerobeam app still running? What is shown may be outdated" });
  }
  if (answer.status === 304) return null;
  let content = null;
  try {
    content = await answer.json();
  } catch { /* an answer that is no JSON is said below */ }
  if (answer.ok && content !== null) return content;
  if (answer.status === STARTED_ANEW) {
    throw new Refused({ what: "the server was started anew",
      to_do: "open the address that the terminal shows; what was saved is in the folder" },
      answer.status);
  }
  throw new Refused(content?.error ?? { what: `the server answered ${answer.status}` }, answer.status,
    content?.current);
}

/** @typedef {import("answers").paths} Paths the end points, as the server's own records describe them */
/** @template R @typedef {R extends {content: {"application/json": infer A}} ? A : unknown} Content */
/**
 * What an end point answers; unknown where its path is made of parts.
 * @template {string} P @template {"get" | "post" | "put"} M
 * @typedef {P extends keyof Paths ? Paths[P][M] extends {responses: infer R} ? Content<R[keyof R & (200 |
 *   201)]> : unknown
 *   : unknown} Answer
 */

/** @template {string} P @param {P} path @returns {Promise<Answer<P, "get">>} */
export const get = (path) => asked("GET", path);
/** @template {string} P @param {P} path @param {unknown} body @returns {Promise<Answer<P, "post">>} */
export const post = (path, body) => asked("POST", path, body);
/** @param {string} path @returns {Promise<unknown>} */
export const remove = (path) => asked("DELETE", path, {});

/**
 * Writes: in place of the `version` that was read; a new file without one.
 * @template {string} P @param {P} path @param {unknown} body @param {string | null} [version]
 *   @returns {Promise<Answer<P, "put">>}
 */
export const put = (path, body, version = null) => asked("PUT", path, body,
  version === null ? { "If-None-Match": "*" } : { "If-Match": `"${version}"` });

/**
 * What an end point says of a file.
 * @template {string} P @param {P} point @param {string} file @returns {Promise<Answer<`/api/${P}`, "get">>}
 */
export const getFile = (point, file) => asked("GET", `/api/${point}?file=${encodeURIComponent(file)}`);

/** @param {string} file */
export const downloadOf = (file) => `/api/file?file=${encodeURIComponent(file)}`;
/** @param {string} file */
export const pageOf = (file) => `/report/${file.split("/").map(encodeURIComponent).join("/")}`;

const LARGEST_UPLOAD = 64e6; // bytes, as the server has it

/**
 * A new file of the folder, under a name that no other has.
 * @param {string} name @param {Blob} content @returns {Promise<import("answers").WrittenFile>}
 */
export async function upload(name, content) {
  if (content.size > LARGEST_UPLOAD) {
    throw new Refused({ what: "the file is too large to be sent", found: `${(content.size / 1e6).toFixed(0)} MB`,
      allowed: "at most 64 MB", to_do: "copy it into the folder of the app" });
  }
  return asked("PUT", downloadOf(name), content, { "If-None-Match": "*" });
}

/**
 * Asks for the newest state only, and says with an answer whether it is still the newest: one request is under way,
 *   what came meanwhile is left out, and between two the page is painted. An answer, or a refusal, is dropped where
 *   `of`, which says what is asked about, is another by then.
 * @template T
 * @param {() => unknown} of
 * @param {() => Promise<T | null>} ask
 * @param {(answer: T, newest: boolean) => void} shown
 * @param {(error: Refused) => void} refused
 */
export function latest(of, ask, shown, refused) {
  let wanted = false, waiting = false, busy = false;
  async function go() {
    waiting = false;
    if (busy || !wanted) return;
    wanted = false;
    busy = true;
    const about = of();
    try {
      const answer = await ask();
      if (answer !== null && of() === about) shown(answer, !wanted);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      if (of() === about) refused(error);
    } finally {
      busy = false;
      if (wanted) soon();
    }
  }
  function soon() {
    if (!waiting) requestAnimationFrame(go);
    waiting = true;
  }
  return () => {
    wanted = true;
    if (!busy && !waiting) queueMicrotask(go);
  };
}
