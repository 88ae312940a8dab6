// What the server is asked: JSON, and errors as {what, found, allowed, to_do, key}.

export class Refused extends Error {
  constructor(facts, status = 0) {
    super(facts.what);
    this.facts = facts;
    this.status = status; // of the answer, 0 where none came
    this.key = facts.key || [];
  }
  get text() {
    const { what, found, allowed, to_do } = this.facts;
    return [what, found && `found: ${found}`, allowed && `allowed: ${allowed}`, to_do && `to do: ${to_do}`].filter(Boolean).join("; ");
  }
}

async function asked(method, path, body) {
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: body === undefined ? {} : { "Content-Type": body instanceof Blob ? "application/octet-stream" : "application/json", "X-Zerobeam": "1" },
      body: body === undefined || body instanceof Blob ? body : JSON.stringify(body),
    });
  } catch {
    throw new Refused({ what: "the server does not answer", to_do: "is zerobeam app still running? What is shown may be outdated" });
  }
  let content = null;
  try {
    content = await answer.json();
  } catch { /* an answer that is no JSON is said below */ }
  if (answer.ok && content !== null) return content;
  throw new Refused((content && content.error) || { what: `the server answered ${answer.status}` }, answer.status);
}

export const get = (path) => asked("GET", path);
export const post = (path, body) => asked("POST", path, body);
export const put = (path, body) => asked("PUT", path, body);
export const remove = (path) => asked("DELETE", path, {});

const LARGEST_UPLOAD = 64e6; // bytes, as the server has it

// A new file of the folder: `content` (a File or Blob) under a name that no other has.
export async function upload(name, content) {
  if (content.size > LARGEST_UPLOAD) {
    throw new Refused({ what: "the file is too large to be sent", found: `${(content.size / 1e6).toFixed(0)} MB`, allowed: "at most 64 MB", to_do: "copy it into the folder of the app" });
  }
  return asked("PUT", `/api/file?file=${encodeURIComponent(name)}`, content);
}

// Asks for the newest state only, and says with an answer whether it is still the newest: one request under way, what came meanwhile is left out, and between two the page is painted.
export function latest(ask, shown, refused) {
  let wanted = false, waiting = false, busy = false;
  async function go() {
    waiting = false;
    if (busy || !wanted) return;
    wanted = false;
    busy = true;
    try {
      const answer = await ask();
      // An answer to a state that has changed since then is shown while dragging, and soon replaced.
      if (answer !== null) shown(answer, !wanted);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refused(error);
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
