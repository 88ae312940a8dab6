// What writes files: the report of a run, the export of its offsets, the comparison of several.
import { get, Refused } from "/page/parts/api.js";
import { by, fill, fixed, make, named, options, spread } from "/page/parts/dom.js";
import { carryOut } from "/page/parts/jobs.js";
import { rounded } from "/page/places/result/answer.js";

// Of each form the words of the command and the ending of its file.
const FORMS = [
  ["robot", "Corrected robot file", "yaml"], ["urdf", "Corrected URDF", "urdf"], ["rapid", "ABB RAPID module", "mod"], ["ur", "Universal Robots joint zero", "txt"],
  ["kuka", "KUKA mastering", "txt"], ["json", "Offsets as JSON", "json"], ["csv", "Offsets as CSV", "csv"],
];

let finished = null;

const stem = (file) => file.slice(file.lastIndexOf("/") + 1).replace(/\.[^.]*$/, "");
const said = (error, box) => { if (!(error instanceof Refused)) throw error; box.hidden = false; fill(box, [make("p", { class: "error", role: "alert" }, error.text)]); };

// A button that is pale while its job is under way.
async function during(button, box, work) {
  button.disabled = true;
  try { await work(); } catch (error) { said(error, box); } finally { button.disabled = false; }
}

export function offerReport(run) {
  by("result-run-title").textContent = run.file;
  by("result-run-about").textContent = run.error || `${[run.robot, run.serial && `serial number ${run.serial}`, run.when, run.who && `by ${run.who}`, run.origin].filter(Boolean).join("; ")}. It has no report yet.`;
  by("result-folder").value = `${run.file.replace(/\.[^./]*$/, "")}-report`;
  by("result-making").hidden = true;
  rejoin(run).catch((error) => said(error, by("result-making")));
}

// A report that was begun before the page was loaded again: it is followed, or has been made meanwhile.
async function rejoin(run) {
  const job = (await get("/api/jobs")).find((one) => one.command[0] === "report" && one.command.at(-1) === run.file);
  if (!job || by("result-make").disabled) return;
  const folder = job.command.find((word) => word.startsWith("--out=")).slice("--out=".length);
  if (["waiting", "running"].includes(job.state)) await report(run, folder, job.id);
  else if (job.state === "done" && await there(`${folder}/result.json`)) await finished(`${folder}/result.json`);
}

const there = (file) => get(`/api/result?file=${encodeURIComponent(file)}`).then(() => true, () => false);

const report = (run, folder, under = null) => during(by("result-make"), by("result-making"), async () => {
  const job = await carryOut(["report", run.file, "-o", folder], by("result-making"), `The report of ${run.file}`, { under });
  if (job.well) await finished(`${folder.replace(/\/+$/, "")}/result.json`);
});

export function offerExport(found) {
  by("export-file").value = `${stem(found.inputs.run) || "run"}-offsets.yaml`;
  by("export-form").value = "robot";
  by("export-without").value = "";
  by("export-job").hidden = true;
  by("export-do").disabled = found.run === null;
  for (const box of document.querySelectorAll("#result-export-fields input[type=checkbox]")) box.checked = false;
}

// `opened` gives the run or result that is open, `made` is called with a new file.
export function beginActions(opened, made) {
  options(by("export-form"), [["what", FORMS.map(([name, text]) => [name, text])]]);
  by("export-form").addEventListener("change", () => {
    const ending = FORMS.find(([name]) => name === by("export-form").value)[2];
    by("export-file").value = `${by("export-file").value.replace(/\.[^./]*$/, "")}.${ending}`;
  });
  finished = made;
  by("result-make").addEventListener("click", () => report(opened(), by("result-folder").value));
  by("export-do").addEventListener("click", () => during(by("export-do"), by("export-job"), async () => {
    const flags = [...document.querySelectorAll("#result-export-fields input:checked")].map((box) => box.dataset.flag);
    const without = by("export-without").value.split(/[\s,]+/).filter(Boolean);
    const file = by("export-file").value, command = ["export", by("export-form").value, opened().run, "-o", file, ...flags, ...without.flatMap((name) => ["--without", name])];
    const job = await carryOut(command, by("export-job"), `Export of ${opened().run}`, { refusal: true });
    if (!job.well) return;
    by("export-job").append(make("p", {}, make("a", { href: `/api/file?file=${encodeURIComponent(file)}`, download: "" }, `Download ${file}`)));
  }));
  by("compare-do").addEventListener("click", () => during(by("compare-do"), by("compare-job"), async () => {
    const files = [...document.querySelectorAll("#compare-choice input:checked")].map((box) => box.value), folder = by("compare-folder").value;
    fill(by("compare-answer"), []);
    const job = await carryOut(["compare", ...files, "-o", folder], by("compare-job"), `Comparison of ${files.length}`);
    if (job.answer && job.answer.schema) showComparison(job.answer, folder);
  }));
}

export function offerComparison(history) {
  const files = [...history.runs.filter((run) => !run.error).map((run) => run.file), ...history.results.filter((own) => !own.error).map((own) => own.file)];
  const checked = new Set([...document.querySelectorAll("#compare-choice input:checked")].map((box) => box.value));
  fill(by("compare-choice"), files.map((file) => { const box = make("input", { type: "checkbox", value: file }); box.checked = checked.has(file); return make("label", { class: "check" }, box, ` ${file}`); }));
  by("compare-folder").value ||= "comparison";
  const ready = () => { by("compare-do").disabled = document.querySelectorAll("#compare-choice input:checked").length < 2; };
  by("compare-choice").addEventListener("change", ready);
  ready();
}

const TONES = { agrees: "pass", "does not agree": "misfit", "not tested": "weak" };

function showComparison(found, folder) {
  const cell = (row, run) => { const own = found.runs[run].offsets.find((one) => one.name === row.name); return own && own.estimate !== null && own.std !== null ? `${rounded(own.estimate, 2 * own.std, row.unit)} ± ${spread(2 * own.std, row.unit)}` : (own && own.status) || "—"; };
  fill(by("compare-answer"), [
    make("div", { class: `verdict ${TONES[found.verdict] || "weak"}` }, make("p", {}, make("span", { class: "word" }, `${found.verdict.charAt(0).toUpperCase()}${found.verdict.slice(1)}.`), ` ${named(found.headline)}`)),
    make("ul", { class: "notes" }, ...found.notes.map((note) => make("li", {}, named(note)))),
    make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Comparison" }, make("table", {},
      make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "offset ± U (k = 2)"), ...found.runs.map((run) => make("th", { scope: "col", class: "right" }, run.name)), make("th", { scope: "col", class: "right" }, "scatter over predicted"))),
      make("tbody", {}, ...found.offsets.map((row) => make("tr", {}, make("th", { scope: "row" }, named(row.name)), ...found.runs.map((_, k) => make("td", { class: "right" }, cell(row, k))), make("td", { class: "right" }, row.ratio === null ? "—" : fixed(row.ratio, 2))))))),
    make("p", {}, make("a", { href: `/report/${folder.split("/").map(encodeURIComponent).join("/")}/compare.html`, target: "_blank", rel: "noopener" }, "Open the whole comparison")),
  ]);
}
