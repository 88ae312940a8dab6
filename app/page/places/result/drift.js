// The drift of the folder's arms: their results are put into a history, a database in the folder, whose pages are shown.
import { Refused } from "/page/parts/api.js";
import { by, fill, make, options } from "/page/parts/dom.js";
import { carryOut } from "/page/parts/jobs.js";

const AT_ONCE = 80; // files of one command

let files = [];

const pages = () => {
  const serial = by("drift-arm").value;
  return serial ? `history-${serial.replace(/[^A-Za-z0-9_]+/g, "-").slice(0, 40)}` : "history";
};

// Results that state whose they are and when: the newest of each run.
export function offerDrift(history) {
  const stated = history.runs.filter((run) => run.serial && run.when && run.results.some((own) => !own.error));
  files = stated.map((run) => run.results.find((own) => !own.error).file);
  const serials = [...new Set(stated.map((run) => run.serial))].sort((a, b) => a.localeCompare(b));
  const chosen = by("drift-arm").value;
  options(by("drift-arm"), [["one arm", serials.map((serial) => [serial, serial])]], "all arms");
  by("drift-arm").value = serials.includes(chosen) ? chosen : "";
  by("drift-do").disabled = !files.length;
  by("drift-about").textContent = files.length
    ? `${files.length} result${files.length === 1 ? "" : "s"} of ${serials.length} arm${serials.length === 1 ? "" : "s"}, with serial number and date.`
    : "No result here has a run that states a serial number and a date.";
}

async function makePages() {
  const db = by("drift-db").value, folder = by("drift-folder").value.replace(/\/+$/, ""), serial = by("drift-arm").value;
  fill(by("drift-making"), []);
  for (let at = 0; at < files.length; at += AT_ONCE) {
    const part = files.slice(at, at + AT_ONCE);
    const job = await carryOut(["history", "add", ...part, "--db", db, "--replace"], by("drift-adding"), `${part.length} results into ${db}`);
    if (!job.well) return;
  }
  const day = by("drift-day").value ? ["--as-of", by("drift-day").value] : [];
  const command = ["history", "report", "--db", db, "--tolerance-mm", by("drift-tolerance").value, ...day, "-o", folder, ...(serial ? ["--", serial] : [])];
  const job = await carryOut(command, by("drift-making"), serial ? `The page of ${serial}` : "The pages of all arms");
  if (job.well) show(`${folder}/${serial ? "arm" : "fleet"}.html`);
}

function show(file) {
  const place = `/report/${file.split("/").map(encodeURIComponent).join("/")}`;
  by("drift-frame").hidden = by("drift-alone").hidden = false;
  by("drift-frame").src = by("drift-alone").href = place;
}

export function beginDrift() {
  by("drift-folder").value = pages();
  by("drift-day").value = new Intl.DateTimeFormat("sv").format(new Date()); // year-month-day, of this place
  by("drift-arm").addEventListener("change", () => { by("drift-folder").value = pages(); });
  by("drift-do").addEventListener("click", async () => {
    by("drift-do").disabled = true;
    by("drift-frame").hidden = by("drift-alone").hidden = true;
    try {
      await makePages();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      by("drift-making").hidden = false;
      fill(by("drift-making"), [make("p", { class: "error", role: "alert" }, error.text)]);
    } finally {
      by("drift-do").disabled = false;
    }
  });
}
