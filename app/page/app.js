// Which place is open, and what all places need. A place is a section of the page and a module of the same name.
import { get, Refused } from "/page/parts/api.js";
import { by, make } from "/page/parts/dom.js";

// The token of the address has become a cookie: it is not left where it is read over a shoulder or copied.
if (location.search) history.replaceState(null, "", location.pathname + location.hash);

const sections = [...document.querySelectorAll("section.work")];
document.querySelector("nav").append(...sections.map((section) => make("a", { href: `#${section.id}` }, section.querySelector("h2").textContent)));
const loaded = await Promise.all(sections.map((section) => import(`/page/places/${section.id}/place.js`)));
const places = new Map(sections.map((section, i) => [section.id, loaded[i].place]));
let open = null;

// The address: #plan, or #plan/FILE for a place that is to show a file.
function go() {
  const [asked, ...file] = location.hash.slice(1).split("/");
  const name = places.has(asked) ? asked : "robot";
  if (name !== open) {
    by("fault").hidden = true;
    if (open) places.get(open).close();
    open = name;
    for (const section of sections) section.hidden = section.id !== name;
    document.querySelector(".columns").classList.toggle("wide", by(name).hasAttribute("data-wide"));
    for (const link of document.querySelectorAll("nav a"))
      if (link.hash === `#${name}`) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    document.title = `${by(`${name}-title`).textContent} – zerobeam`;
    places.get(name).open();
    scrollTo(0, 0);
  }
  if (file.length && places.get(name).show) places.get(name).show(decodeURIComponent(file.join("/")));
}

by("scene").addEventListener("chosen", (event) => open && places.get(open).chosen(event.detail));
addEventListener("hashchange", go);
try {
  const [robots, files] = await Promise.all([get("/api/robots"), get("/api/files")]);
  await Promise.all([...places.values()].map((place) => place.begin(robots, files)));
} catch (error) {
  if (!(error instanceof Refused)) throw error;
  by("fault").textContent = error.text;
  by("fault").hidden = false;
}
go();
