// Where the page begins: its frame is shown, the folder is read, then what the address names.
import { html } from "htm/preact";
import { render } from "preact";
import { App } from "./App.js";
import { unsaved } from "./core/editing.js";
import { follow, guardLeaving } from "./core/route.js";
import { begin } from "./core/store.js";
import { leaving } from "./parts/Unsaved.js";

guardLeaving((to) => {
  if (unsaved.peek()) leaving.value = to;
  return !unsaved.peek();
});
follow();
const root = /** @type {HTMLElement} */ (document.getElementById("app"));
render(html`<${App} />`, root);
begin();
