// The place Result: the answer to a run, its report and posterior, what single measurements do to it, comparison and history.
import { get, Refused } from "/page/parts/api.js";
import { by, named, options, say } from "/page/parts/dom.js";
import { beginActions, offerComparison, offerExport, offerReport } from "/page/places/result/actions.js";
import { showAnswer, showRefit } from "/page/places/result/answer.js";
import { beginDrift, offerDrift } from "/page/places/result/drift.js";
import { bySerial, showHistory } from "/page/places/result/history.js";
import { beginMeasurements, brushed, showMeasurements } from "/page/places/result/measurements.js";
import { beginPairs, showPairs } from "/page/places/result/pairs.js";

let history = null, open = null, loading = null;

function load() {
  loading = listed();
  return loading;
}

async function listed() {
  history = await get("/api/history");
  const runs = bySerial(history.runs).map(([serial, own]) => [serial, own.flatMap((run) => [...run.results.map((result) => [result.file, `${run.file}: ${result.file}`]), ...(run.results.length ? [] : [[run.file, `${run.file}, no report yet`]])])]);
  options(by("result-open"), [...runs, ["results without their run", history.results.map((own) => [own.file, own.file])]], "choose …");
  showHistory(history, show);
  offerComparison(history);
  offerDrift(history);
  if (open) chosen(open.file);
}

// What is open, also where the list lacks it.
function chosen(file) {
  const select = by("result-open");
  if (![...select.options].some((one) => one.value === file)) select.add(new Option(file, file));
  select.value = file;
}

function failed(error) {
  if (!(error instanceof Refused)) throw error;
  by("result-error").textContent = error.text;
  by("result-error").hidden = false;
}

// A run that has a result is shown by its newest one.
async function show(wanted) {
  by("result-error").hidden = true;
  if (!wanted) return;
  const made = history && history.runs.find((own) => own.file === wanted)?.results.find((own) => !own.error);
  const file = made ? made.file : wanted;
  chosen(file);
  window.history.replaceState(null, "", `#result/${file.split("/").map(encodeURIComponent).join("/")}`);
  const run = history && history.runs.find((own) => own.file === file);
  by("result-run").hidden = by("result-work").hidden = true;
  open = null;
  if (run) {
    open = run;
    offerReport(run);
    by("result-run").hidden = false;
    return;
  }
  try {
    const found = await get(`/api/result?file=${encodeURIComponent(file)}`);
    if (by("result-open").value !== file) return;
    open = found;
    by("result-work").hidden = false;
    showAnswer(found);
    showRefit(null);
    showMeasurements(found);
    offerExport(found);
    say(found.message ? found.message.verdict : `${found.verdict}. ${named(found.headline)}`);
    await posterior(found);
  } catch (error) {
    failed(error);
  }
}

async function posterior(found) {
  const unknown = found.parameters.filter((row) => row.group === "offset" && row.status === "unidentifiable").map((row) => named(row.name));
  const said = unknown.length ? [`${unknown.join(", ")}: prior only, the measurements do not determine ${unknown.length === 1 ? "it" : "them"}; not drawn.`] : [];
  showPairs(null, [], brushed);
  let drawn = null;
  if (found.posterior_file === null) said.push(found.posterior.message || "There is no posterior.nc beside this result.");
  else {
    drawn = await get(`/api/posterior?file=${encodeURIComponent(found.posterior_file)}`);
    if (open !== found) return;
    if (!drawn.converged) said.push(`No posterior is shown: ${found.posterior.message || "it has not converged"}`);
    else if (!drawn.names.length) said.push("The measurements determine no offset: there is nothing to draw.");
    else said.push(`${drawn.draws[0].length} of ${drawn.total} draws.`);
  }
  by("result-unknown").textContent = said.map(named).join(" ");
  showPairs(drawn && drawn.converged ? drawn : null, found.parameters, brushed);
}

export const place = {
  async begin() {
    beginPairs();
    beginMeasurements();
    beginDrift();
    beginActions(() => open, async (file) => {
      const asked = by("result-open").value;
      await load();
      if (by("result-open").value === asked) await show(file);
    });
    by("result-open").addEventListener("change", () => show(by("result-open").value));
    for (const link of document.querySelectorAll("#result .contents a")) {
      link.addEventListener("click", (event) => {
        event.preventDefault();
        const to = document.querySelector(link.getAttribute("href"));
        to.scrollIntoView();
        to.focus({ preventScroll: true });
      });
    }
  },
  open() { load().catch(failed); },
  close() {},
  chosen() {},
  async show(file) { try { await (loading || load()); } catch (error) { failed(error); } await show(file); },
};
