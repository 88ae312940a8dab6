// The page: what the address names, below one bar.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { calibrationOf, go, route, STEPS, toImport, toJob } from "./core/route.js";
import { file, lostDraftsOf } from "./core/editing.js";
import { begun, calibration, failed, fault, home, notice } from "./core/store.js";
import { capital } from "./core/words.js";
import { Drafts } from "./home/Drafts.js";
import { Home } from "./home/Home.js";
import { StopBar } from "./measure/StopBar.js";
import { Conflict, Leaving } from "./parts/Unsaved.js";

/**
 * What a step needs is fetched when it is opened.
 * @type {Record<string, () => Promise<import("preact").ComponentType>>}
 */
const VIEWS = {
  new: () => import("./home/New.js").then((module) => module.New),
  import: () => import("./import/Import.js").then((module) => module.Import),
  cell: () => import("./cell/Cell.js").then((module) => module.Cell),
  plan: () => import("./plan/Plan.js").then((module) => module.Plan),
  measure: () => import("./measure/Measure.js").then((module) => module.Measure),
  result: () => import("./result/Result.js").then((module) => module.Result),
};

const WAITING = html`<p class="muted" role="status">…</p>`;

/** @param {{of: string}} props */
function View({ of }) {
  const loaded = useSignal(/** @type {{of: string, view: import("preact").ComponentType} | null} */ (null));
  useEffect(() => { VIEWS[of]().then((view) => { loaded.value = { of, view }; }, failed); }, [of]);
  return begun.value && loaded.value?.of === of ? html`<${loaded.value.view} />` : WAITING;
}

/** Where the calibration is: its four steps. */
function Rail() {
  const { name, step } = route.value, known = calibration.value;
  const counts = { cell: "", plan: known?.files.plan.length ?? 0, measure: known?.files.run.length ?? 0,
    result: known?.files.result.length ?? 0 };
  return html`
    <nav class="rail" aria-label="Steps of the calibration">
      ${STEPS.map((one, i) => html`
        <a key=${one} href=${toJob(name, one)}
          aria-current=${one === step ? "step" : undefined}>
          <b>${i + 1}</b> ${capital(one)}${Number(counts[one]) > 1 && html` <small>${counts[one]}</small>`}</a>`)}
    </nav>`;
}

export function App() {
  const { view, name, step } = route.value, known = calibration.value;
  const titles = { home: "Calibrations", new: "New calibration", import: "Import a recording",
    job: `${name === "." ? "This folder" : name}: ${step}` };
  const content = useRef(/** @type {HTMLElement | null} */ (null)), first = useRef(true);
  useEffect(() => {
    document.title = `${titles[view]} – zerobeam`;
    // Who goes on by keyboard begins at the content of the new view, not at the head of the page.
    if (!first.current) { content.current?.focus({ preventScroll: true }); scrollTo(0, 0); }
    if (!first.current) fault.value = ""; // of the view that is left
    first.current = false;
  }, [view, name, step]);
  const missing = view === "job" && home.value !== null && known === null, drafts = missing ? lostDraftsOf(name) : [];
  // A draft is shown as the plan that it was, and stays while it is saved again.
  const opened = drafts.length > 0 || (file.value !== "" && calibrationOf(file.value) === name);
  const lost = missing && (step !== "plan" || !opened);
  return html`
    <a class="skip" href="#content"
      onClick=${(/** @type {Event} */ event) => { event.preventDefault(); content.current?.focus(); }}
    >To the content</a>
    <header class="top">
      <a class="brand" href="#/" aria-current=${view === "home" ? "page" : undefined}>zerobeam</a>
      ${view === "job"
        ? html`
          <h1>${name === "." ? "This folder" : name}</h1>
          <p class="muted about">
            ${known
              && [known.model ?? known.robot, known.serial?.startsWith("none") ? null : known.serial,
                known.state.text].filter(Boolean)
                .join(" · ")}</p>`
        : html`<h1>${titles[view]}</h1>`}
      ${view === "home" ? html`<a class="button" href=${toImport()}>Import a recording</a>`
        : html`<a class="button" href="#/">All calibrations</a>`}
    </header>
    ${fault.value && html`
      <p class="fault" role="alert">
        ${fault.value} <button type="button" onClick=${() => { fault.value = ""; }}>Close</button></p>`}
    <div class=${`body ${view}`}>
      ${view === "job" && html`<${Rail} />`}
      <main id="content" tabindex="-1" ref=${content}>
        ${lost ? html`
          <p>There is no calibration of this name in the
            folder. <button type="button" onClick=${() => go("#/")}>All calibrations</button></p>
          <${Drafts} drafts=${drafts} />`
          : view === "home" ? (begun.value ? html`<${Home} />` : WAITING)
            : html`<${View} key=${view === "job" ? `${name} ${step}` : view} of=${view === "job" ? step : view} />`}
      </main>
    </div>
    <${StopBar} />
    <p class="notice" role="status">${notice.value}</p>
    <${Conflict} />
    <${Leaving} />`;
}
