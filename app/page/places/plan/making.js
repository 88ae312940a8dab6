// A new plan by the command `plan`: the best of many candidate postures, or a pattern of the paper.
import { get, put, Refused } from "/page/parts/api.js";
import { by, fill, make, options, sentence } from "/page/parts/dom.js";
import { carryOut } from "/page/parts/jobs.js";

const OF_PLAN = " "; // the header of the plan that is open: no file has this name
const text = (id) => by(`make-${id}`).value.trim();

// What all measurements have in common, as a header file beside the plan states it.
function headerOf(plan) {
  const { schema, postures_deg, constraints, targets, ...header } = plan;
  const names = Object.keys(targets || {});
  return names.length === 1 && ["psd", "socket"].includes(names[0]) ? { ...header, targets } : header;
}

// A new file, or the same one: nothing is replaced.
async function headerFile(plan, folder, name) {
  const file = `${folder}${name}`, header = headerOf(plan);
  try {
    await put(`/api/file?file=${encodeURIComponent(file)}`, header);
  } catch (error) {
    if (!(error instanceof Refused) || error.status === 0) throw error;
    const same = await get(`/api/file?file=${encodeURIComponent(file)}`).catch(() => null);
    if (JSON.stringify(same) !== JSON.stringify(header)) throw error;
  }
  return file;
}

function words(header, out) {
  const kind = text("kind"), best = kind === "optimal";
  const stated = [["--header", header], ["--out", out], ["--target", ["x", "y", "z"].map((axis) => text(axis) || "?").join(",")]];
  if (!best || !text("tolerance")) stated.push(["--shots", text("shots")]);
  if (best) {
    if (text("tolerance")) stated.push(["--tolerance", text("tolerance")], ["--max-shots", text("most")]);
    stated.push(["--criterion", text("criterion")], ["--candidates", text("candidates")], ["--facing", text("facing")], ["--acceptance", text("acceptance")],
      ["--beam", `${text("shortest")},${text("longest")}`], ["--margin", text("margin")], ["--obstacles", text("obstacles")], ["--seed", text("seed")]);
  }
  return ["plan", kind, ...stated.filter(([, value]) => value !== "").map(([name, value]) => `${name}=${value}`)];
}

// `current()` is the plan that is open, its file and nominal target; `open(file)` opens the one that was made.
export function beginMaking(current, open) {
  const kind = () => { for (const part of document.querySelectorAll("#make .best")) part.hidden = text("kind") !== "optimal"; };
  by("make-kind").addEventListener("change", kind);
  kind();
  by("make-box").addEventListener("toggle", () => {
    const { target } = current();
    if (by("make-box").open && target && !text("x")) ["x", "y", "z"].forEach((axis, i) => { by(`make-${axis}`).value = Number(target[i].toFixed(3)); });
  });
  by("make").addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = by("make-go"), out = text("file");
    button.disabled = true;
    fill(by("make-said"), []);
    by("make-job").hidden = true;
    try {
      const { plan, folder } = current();
      const header = by("make-header").value === OF_PLAN ? await headerFile(plan, folder, `${out.replace(/^.*\//, "").replace(/\.ya?ml$/, "")}-header.yaml`) : by("make-header").value;
      const job = await carryOut(words(header, out), by("make-job"), "Making the plan");
      if (job.state !== "done" || !job.answer) return;
      fill(by("make-said"), [...job.answer.said, ...(job.answer.removed ? [job.answer.removed] : [])].map((line) => make("li", {}, sentence(line))));
      if (job.answer.plan !== null) await open(out);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      fill(by("make-said"), [make("li", { class: "fault" }, error.text)]);
    } finally {
      button.disabled = false;
    }
  });
}

export function listHeaders(files, open) {
  const chosen = by("make-header").value;
  options(by("make-header"), [["this page", open ? [[OF_PLAN, "of the plan that is open"]] : []], ["header files of this folder", files.filter((f) => f.kind === "header").map((f) => [f.path, f.path])]]);
  const all = [...by("make-header").options].map((o) => o.value);
  if (all.includes(chosen)) by("make-header").value = chosen;
  by("make-go").disabled = !all.length;
  by("make-none").hidden = all.length > 0;
  options(by("make-obstacles"), [["obstacles of this folder", files.filter((f) => f.kind === "obstacles").map((f) => [f.path, f.path])]], "none");
}
