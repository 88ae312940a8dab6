// Which place is open, and what all places need.
import { get, Refused } from "/page/api.js";
import { by } from "/page/dom.js";
import { plan } from "/page/plan.js";
import { robot } from "/page/robot.js";

const places = { robot, plan };
let open = null;

function go() {
  const name = Object.hasOwn(places, location.hash.slice(1)) ? location.hash.slice(1) : "robot";
  if (name === open) return;
  by("fault").hidden = true;
  if (open) places[open].close();
  open = name;
  for (const other of Object.keys(places)) by(other).hidden = other !== name;
  for (const link of document.querySelectorAll("nav a"))
    if (link.hash === `#${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  document.title = `${by(`${name}-title`).textContent} – zerobeam`;
  places[name].open();
  scrollTo(0, 0);
}

by("scene").addEventListener("chosen", (event) => open && places[open].chosen(event.detail));
addEventListener("hashchange", go);
try {
  const [robots, files] = await Promise.all([get("/api/robots"), get("/api/files")]);
  await Promise.all(Object.values(places).map((place) => place.begin(robots, files)));
} catch (error) {
  if (!(error instanceof Refused)) throw error;
  by("fault").textContent = error.text;
  by("fault").hidden = false;
}
go();
