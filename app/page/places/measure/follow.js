// A job under way: its events as they come, and again after a lost connection or a reload. The browser asks anew from behind the last event by itself.
import { get, Refused } from "/page/parts/api.js";
import { begun, hear } from "/page/places/measure/run.js";

const AGAIN_MS = 1500; // until a server that was ended is asked whether it is there again

// `changed` is called with {job, run, log, lost} after every event, `gone` when the job is not known any more.
export function follow(id, changed, gone) {
  const seen = { job: { id, state: "running", share: 0, asks: null }, run: begun(), log: [], lost: false };
  let source = null, over = false, timer = null;

  const told = (event) => JSON.parse(event.data);
  function listen() {
    source = new EventSource(`/api/jobs/${encodeURIComponent(id)}/events`);
    source.addEventListener("open", () => { seen.lost = false; changed(seen); });
    source.addEventListener("progress", (event) => { Object.assign(seen.job, told(event)); changed(seen); });
    source.addEventListener("log", (event) => { seen.log.push(told(event)); changed(seen); });
    source.addEventListener("run", (event) => { hear(seen.run, told(event)); changed(seen); });
    source.addEventListener("end", (event) => {
      const last = told(event);
      close();
      seen.job = last;
      seen.log = last.log;
      changed(seen);
    });
    source.addEventListener("error", () => {
      seen.lost = true;
      changed(seen);
      // Refused, not merely cut off: a server that was started anew does not know this job.
      if (source.readyState === EventSource.CLOSED) ask();
    });
  }
  async function ask() {
    if (over) return;
    try {
      await get(`/api/jobs/${encodeURIComponent(id)}`);
      if (!over) listen();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      if (over) return;
      if (error.status === 404) { close(); gone(); } else timer = setTimeout(ask, AGAIN_MS);
    }
  }
  function close() {
    over = true;
    clearTimeout(timer);
    if (source) source.close();
  }
  get(`/api/jobs/${encodeURIComponent(id)}`).then((job) => { if (!over) { Object.assign(seen.job, job); listen(); } }, (error) => {
    if (!(error instanceof Refused)) throw error;
    ask();
  });
  return { seen, close };
}
