// A command carried out by the server: begun, followed, ended.
import { post, Refused } from "/page/parts/api.js";
import { make } from "/page/parts/dom.js";

// Carries `command` (its words) out, or follows the job `id` of it that is under way, and shows it in `box`: progress, time left, a button that ends it, and what it says.
// Resolves to the job when it has ended, `well` if it did what was asked; throws Refused where it cannot begin.
// `refusal`: the exit status 1 is one, and no verdict.
export async function carryOut(command, box, title, { refusal = false, under = null } = {}) {
  const bar = make("progress", { max: 1, value: 0, "aria-label": title });
  const said = make("output", {}, "waiting");
  const log = make("pre", { class: "log", tabindex: 0, "aria-label": "What the command says" });
  log.hidden = true;
  const id = under || (await post("/api/jobs", { command })).id;
  const end = make("button", { type: "button", onclick: () => fetch(`/api/jobs/${id}`, { method: "DELETE", headers: { "X-Zerobeam": "1" } }) }, "Cancel");
  box.replaceChildren(make("p", {}, title), make("div", { class: "bar" }, bar, end, said), log);
  box.hidden = false;
  const line = (text) => { log.hidden = false; log.textContent += `${text}\n`; };
  return new Promise((resolve, reject) => {
    let told = null, at = 0;
    const stalled = setInterval(() => {
      if (told?.left_s != null && Date.now() - at > 1000 * Math.max(5, told.left_s)) said.textContent = `${told.stage}, longer than estimated`;
    }, 1000);
    const events = new EventSource(`/api/jobs/${id}/events`);
    events.addEventListener("progress", (event) => {
      told = JSON.parse(event.data);
      at = Date.now();
      bar.value = told.share;
      said.textContent = `${told.stage}${told.left_s === null ? "" : `, ${told.left_at_least ? "at least" : "about"} ${Math.max(1, Math.round(told.left_s))} s left`}`;
    });
    events.addEventListener("log", (event) => line(JSON.parse(event.data)));
    events.addEventListener("end", (event) => {
      events.close();
      clearInterval(stalled);
      const job = JSON.parse(event.data);
      end.remove();
      bar.remove();
      job.well = job.state === "done" && !(refusal && job.status === 1);
      said.textContent = job.well ? "Done." : job.state === "stopped" ? "Cancelled: nothing was written." : "Refused, or failed:";
      log.textContent = job.log.join("\n");
      log.hidden = job.well || job.state === "stopped" || !job.log.length;
      resolve(job);
    });
    events.addEventListener("error", () => {
      if (events.readyState !== EventSource.CLOSED) return;
      clearInterval(stalled);
      end.remove();
      reject(new Refused({ what: "the server does not answer", to_do: "is zerobeam app still running?" }));
    });
  });
}
