// The saved plan as a program for a controller, or as a sheet for the person at the robot.
import { Refused } from "/page/parts/api.js";
import { by, make } from "/page/parts/dom.js";
import { carryOut } from "/page/parts/jobs.js";

const ENDINGS = { rapid: ["mod"], urscript: ["script"], krl: ["src", "dat"], fanuc: ["ls"], robodk: ["py"], ros: ["yaml"], csv: ["csv"], pdf: ["pdf"] };
const OPTIONS = { speed: ["rapid", "urscript", "krl", "fanuc", "robodk", "ros"], zone: ["rapid", "urscript", "robodk", "krl", "fanuc"], tool: ["rapid", "krl", "fanuc"], j3: ["fanuc", "robodk", "csv", "pdf"], register: ["fanuc"] };
const kind = () => by("program-kind").value;

export const link = (file) => make("a", { href: `/api/file?file=${encodeURIComponent(file)}`, download: file.replace(/^.*\//, "") }, file);

function name(file) {
  const stem = (file || "plan.yaml").replace(/\.ya?ml$/, "");
  by("program-file").value = `${kind() === "pdf" ? stem : stem.replace(/[^/\w]/g, "_")}.${ENDINGS[kind()][0]}`;
}

// `file()` is the plan's file as it was saved, empty where it is not.
export function beginExporting(file) {
  const changed = () => {
    for (const label of document.querySelectorAll("#program [data-option]")) label.hidden = !OPTIONS[label.dataset.option].includes(kind());
    name(file());
  };
  by("program-kind").addEventListener("change", changed);
  by("program-box").addEventListener("toggle", changed);
  changed();
  by("program").addEventListener("submit", async (event) => {
    event.preventDefault();
    const box = by("program-job"), plan = file(), out = by("program-file").value.trim();
    const refuse = (text) => { box.hidden = false; box.replaceChildren(make("p", { class: "fault" }, text)); };
    if (!plan) { refuse("Save the plan first: what is exported is its file."); return; }
    const stated = Object.keys(OPTIONS).filter((option) => OPTIONS[option].includes(kind()) && by(`program-${option}`).value.trim()).map((option) => `--${option}=${by(`program-${option}`).value.trim()}`);
    by("program-go").disabled = true;
    try {
      const job = await carryOut(["export", "plan", kind(), plan, `--out=${out}`, ...stated], box, `Writing ${out}`, true);
      if (job.well) box.append(make("p", {}, "Download: ", ...ENDINGS[kind()].flatMap((ending, i) => [i ? ", " : "", link(i ? out.replace(/\.[^./]*$/, `.${ending}`) : out)])));
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refuse(error.text);
    } finally {
      by("program-go").disabled = false;
    }
  });
}
