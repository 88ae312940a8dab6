// What a person sees of a run under way.
import { by, fill, fixed, make, named, say, spread } from "/page/parts/dom.js";
import { showMessage } from "/page/parts/message.js";
import { posed, show } from "/page/parts/picture.js";
import { course, picture, psd, span, trace } from "/page/places/measure/pictures.js";

const ANSWERS = { yes: "Record it all the same", rad: "They are radians" };
const MOVING_MS = 80; // an arm that is sent elsewhere is seen going there
const NEAR_MM = 2;
// A run that has not advanced for long takes longer, one with a tolerance may need fewer measurements.
const leftHow = (atLeast, mayEndSooner) => (atLeast === mayEndSooner ? "about" : atLeast ? "at least" : "at most");
const left = (s) => (s < 90 ? `${Math.round(s)} s` : `${Math.round(s / 60)} min`);
const counted = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;

export class Live {
  // `answer(line)` sends a line to the job.
  constructor(answer) {
    this.answer = answer;
    this.plan = null; // {scene, reach, units by offset, of}
    this.earlier = []; // u after the measurements of earlier sessions
    this.visible = false;
    this.waiting = false;
    this.shown = {};
  }

  begin() {
    this.earlier = [];
    this.shown = {};
    this.at = this.goal = null;
    this.moving = false;
    by("measure-run").hidden = false;
    by("measure-line").value = "";
  }

  changed(seen) {
    this.seen = seen;
    if (!this.waiting) requestAnimationFrame(() => { this.waiting = false; this.render(); });
    this.waiting = true;
  }

  render() {
    const { job, run, log, lost } = this.seen;
    const now = this.now(job, run, lost);
    this.once("now", now, () => {
      const box = by("measure-now");
      if (run.end) showMessage(box, run.end.verdict, run.end.message, [make("p", {}, now)]);
      else { box.className = "verdict"; fill(box, [make("p", {}, now)]); }
    });
    by("measure-progress").value = job.share;
    by("measure-time").textContent = this.time(job, run);
    const notes = this.notes(job, run, log);
    this.once("notes", JSON.stringify(notes), () => fill(by("measure-notes"), notes.map((note) => make("li", {}, named(note)))));
    this.once("log", log.length, () => { by("measure-log").textContent = log.join("\n"); });
    const file = run.end && by("result") ? (job.command || []).find((word) => word.startsWith("--out=")) : null;
    by("measure-next").hidden = !file;
    if (file) by("measure-next").firstElementChild.href = `#result/${encodeURIComponent(file.slice(6))}`;
    this.confirm(job, run);
    this.hand(job, run);
    const trail = run.trace.length ? run.trace : this.shown.trail || [];
    this.once("trace", trail, () => { this.shown.trail = trail; });
    this.once("traced", `${run.shot} ${run.attempt} ${trail.length}`, () => {
      by("measure-trace").lastElementChild.replaceChildren(trace(trail));
      by("measure-psd").lastElementChild.replaceChildren(psd(trail, run.size));
    });
    for (const id of ["measure-trace", "measure-psd"]) by(id).hidden = run.rig === "manual";
    by("measure-camera-seen").hidden = run.picture === null;
    if (run.picture) this.once("picture", run.picture, () => picture(by("measure-camera-seen").lastElementChild, run.picture));
    this.table(run);
    this.scene(run);
  }

  once(what, value, then) {
    if (this.shown[what] === value) return;
    this.shown[what] = value;
    then();
  }

  now(job, run, lost) {
    if (lost && !["done", "stopped", "failed"].includes(job.state)) return "The connection to the server is lost. The run goes on as long as the server does; this page tries again. Where the app was started anew, open the address that it prints.";
    const kept = `${counted(run.recorded.length, "measurement")} ${run.recorded.length === 1 ? "is" : "are"} kept in ${run.file}.`;
    if (run.end) return kept;
    const left = run.file && run.counted ? ` ${kept}` : "";
    if (job.state === "stopped") return run.file ? `Stopped.${left}` : "Stopped before anything was recorded.";
    if (job.state === "failed") return `The run ended with an error.${left}`;
    if (job.state === "done") return kept;
    if (run.confirm && job.asks === "confirm") return "Waiting for your confirmation: nothing has moved yet.";
    if (run.shot === null) return "The run begins.";
    const count = run.recorded.length + run.refused.length + 1;
    const of = count > run.postures ? `${count}` : `${count} of ${run.postures}`;
    return `Measurement ${run.shot} (${of})${run.attempt > 1 ? `, attempt ${run.attempt}` : ""}${run.phase ? `: ${run.phase}` : ""}`;
  }

  time(job, run) {
    const parts = [`${counted(run.recorded.length, "measurement")} recorded${run.refused.length ? `, ${run.refused.length} refused` : ""}, of ${run.postures} planned`];
    if (job.state === "running" && job.left_s !== null && job.left_s !== undefined && run.rig !== "manual") parts.push(`${leftHow(job.left_at_least, run.tolerance !== null)} ${left(job.left_s)} left`);
    return `${parts.join("; ")}.`;
  }

  notes(job, run, log) {
    const own = [];
    if (!run.consistent && !run.end) own.push("The measurements contradict the model or each other: no estimate or uncertainty can be relied on.");
    if (run.suspect) own.push(`Measurement ${run.suspect.shot} contradicts the others: its residual at their fit is ${fixed(run.suspect.residual_mm, 3)} mm.`);
    if (run.stopped && run.stopped !== "interrupted") own.push(run.stopped);
    else if (run.trouble && !run.end) own.push(run.trouble);
    if (job.state === "failed") own.push(...log.filter((line) => line.startsWith("error: ")).map((line) => line.slice(7)));
    return run.end ? [...own, ...run.end.notes] : own;
  }

  confirm(job, run) {
    const asked = Boolean(run.confirm) && job.asks === "confirm";
    this.once("confirm", asked, () => {
      by("measure-confirm").hidden = !asked;
      if (!asked) return;
      by("measure-confirm-text").textContent = run.confirm;
      by("measure-no").focus(); // not what moves: who presses Enter by habit moves nothing
    });
  }

  hand(job, run) {
    const asked = run.asked !== null && job.asks === "lines" && job.state === "running" && !run.end;
    const form = by("measure-hand");
    if (form.hidden === asked) form.hidden = !asked;
    if (!asked) return;
    this.once("asked", run.asked, () => {
      const own = run.asked, closing = own.shot >= own.postures ? ", closing" : "";
      by("measure-asked").textContent = `Posture ${own.done + 1} of ${Math.max(own.postures, own.done + 1)} (measurement ${own.shot}${closing}), target ${own.target}`;
      fill(by("measure-joints"), own.pendant.map((joint) => make("li", {}, make("b", {}, joint.name), fixed(joint.value, joint.unit === "rad" ? 4 : joint.unit === "pulse" ? 0 : 2))));
      by("measure-line").value = "";
      if (this.visible && (document.activeElement === document.body || form.contains(document.activeElement))) by("measure-line").focus();
      say(by("measure-asked").textContent);
    });
    this.once("doubt", run.doubt, () => {
      const box = by("measure-doubt"), doubt = run.doubt;
      by("measure-line").setAttribute("aria-invalid", String(Boolean(doubt)));
      if (!doubt) { fill(box, []); return; }
      const word = doubt.kind === "help" ? doubt.found : `Not recorded: ${doubt.found}.`;
      const buttons = doubt.answers.map((answer) => make("button", { type: "button", onclick: () => this.answer(answer) }, ANSWERS[answer] || `It is posture ${answer.slice(3)}`));
      fill(box, [make("p", {}, word), ...(buttons.length ? [make("div", { class: "bar" }, ...buttons)] : [])]);
      by("measure-line").focus();
    });
  }

  table(run) {
    const rows = [...this.earlier.filter((row) => !run.course.length || row.recorded < run.course[0].recorded), ...run.course];
    const std = run.std || (rows.length ? rows.at(-1).std : null);
    this.once("table", JSON.stringify([rows.length, std]), () => {
      const body = by("measure-table").tBodies[0], all = span(rows);
      if (std === null) { fill(body, [make("tr", {}, make("td", { colspan: 3, class: "muted" }, "No measurement yet."))]); return; }
      fill(body, Object.entries(std).map(([name, value]) => make("tr", { "data-of": name },
        make("th", { scope: "row" }, named(name)),
        make("td", { class: `right u${value === null ? " unknown" : ""}` }, value === null ? "not determined yet" : spread(value, (this.plan && this.plan.units[name]) || "deg")),
        make("td", {}, course(rows, name, all)))));
    });
  }

  scene(run) {
    const plan = this.plan;
    if (!this.visible || !plan || (!run.arm && this.shown.planned === plan)) return;
    if (!run.arm) { this.shown.planned = plan; this.draw(null, null); return; }
    if (this.shown.arm === run.arm) return;
    this.shown.arm = run.arm;
    this.goal = [...run.arm.arm, ...run.arm.beam];
    const still = !this.at || this.at.length !== this.goal.length || matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (still) { this.draw(run.arm, this.goal); return; }
    if (!this.moving) this.move(performance.now());
  }

  // One step of the way at each frame, however often the arm is sent elsewhere meanwhile.
  move(before) {
    this.moving = true;
    requestAnimationFrame((now) => {
      this.moving = false;
      const arm = this.shown.arm, to = this.goal;
      if (!arm || !this.visible || this.at.length !== to.length) return;
      const share = 1 - Math.exp(-(now - before) / MOVING_MS);
      const near = Math.max(...to.map((p, i) => Math.hypot(...p.map((v, k) => v - this.at[i][k])))) < NEAR_MM;
      this.draw(arm, near ? to : to.map((p, i) => p.map((v, k) => this.at[i][k] + share * (v - this.at[i][k]))));
      if (!near) this.move(now);
    });
  }

  draw(arm, points) {
    const plan = this.plan, targets = new Map(plan.scene.map((place) => [place.target_name, { name: place.target_name, at: place.target, state: "nominal" }]));
    const postures = plan.scene.map((place, i) => posed(`posture ${i}`, place.skeleton, place.tool, null, place.reaches));
    if (arm) {
      this.at = points;
      const links = points.slice(0, arm.arm.length), beam = points.slice(arm.arm.length);
      postures.push(posed(`measurement ${arm.shot}`, links, beam[0], arm.lit && beam.length > 1 ? beam : null));
    }
    show(`measure ${plan.of}`, postures, [...targets.values()], arm ? postures.length - 1 : null, plan.reach,
      arm ? `The arm as it was sent${arm.lit ? ", with the beam as it is believed to be" : ""}. The plan’s postures are pale.` : "The plan’s postures, as the servo will leave them.");
  }
}
