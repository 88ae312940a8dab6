// What the button beside a message does: a job, postures that are applied, measurements that are left out, or a step
// that is opened. The server says which.
import { begin, outOf, well } from "./jobs.js";
import { change, file } from "./editing.js";
import { refresh } from "./store.js";
import { calibrationOf, go, goOn, route, toJob } from "./route.js";

/** @typedef {NonNullable<import("answers").OfferedAction["does"]>} Deed */

/**
 * @param {Deed} deed @param {(job: import("./jobs.js").Followed) => void} begun
 * @param {(measurements: number[]) => void} leaveOut
 */
export async function doAction(deed, begun, leaveOut) {
  const from = route.value, { name } = from;
  if (deed.kind === "step") go(toJob(name, deed.step, deed.step === "plan" || deed.step === "cell" ? file.value : ""));
  else if (deed.kind === "postures") apply(deed);
  else if (deed.kind === "leave_out") leaveOut(deed.measurements);
  else {
    const job = await begin(deed.command);
    begun(job);
    const ended = await job.ended;
    await refresh();
    if (!well(ended)) return;
    const out = outOf(deed.command);
    if (deed.then === "plan" && out) goOn(from, toJob(calibrationOf(out), "plan", out));
    else if (deed.then === "result" && out) goOn(from, toJob(name, "result", `${out.replace(/\/+$/, "")}/result.json`));
  }
}

/**
 * The suggested postures become those of the plan, each with its target where there are several: they can be undone.
 * @param {import("answers").DoesPostures} suggested
 */
function apply({ postures_deg, targets, again }) {
  change(null, (content) => {
    content.postures_deg = postures_deg.map((joints_deg, i) => {
      const repeated = again?.[i] ?? null;
      return targets || repeated !== null
        ? { joints_deg, ...(targets ? { target: targets[i] } : {}), ...(repeated === null ? {} : { again: repeated }) }
        : joints_deg;
    });
  });
}
