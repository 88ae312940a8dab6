// A form for a JSON Schema: a field for each key with its description, and the content that the fields state.
import { fill, make } from "/page/parts/dom.js";

const title = (key) => key.replace(/_(mm|deg|kg)$/, "").replaceAll("_", " ").replace(/^./, (c) => c.toUpperCase());
const unit = (key) => ({ mm: "mm", deg: "°", kg: "kg" })[(key.match(/_(mm|deg|kg)$/) || [])[1]] || (key === "mm" ? "mm" : "");
const numbers = (text) => text.split(/[\s,;]+/).filter(Boolean).map(number);
const number = (text) => (/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(text) ? Number(text) : text);
let count = 0;

export class Form {
  // `lists` has words that a field may take, by its key (robots, targets).
  constructor(parent, schema, lists, changed) {
    this.parent = parent;
    this.schema = schema;
    this.lists = lists;
    this.changed = changed;
    this.show({});
  }

  show(content) {
    this.root = this.object(this.schema, [], content, true);
    fill(this.parent, [this.root.element]);
  }

  get content() { return this.root.value() || {}; }

  resolved(schema) {
    const own = schema.$ref ? { ...this.schema.$defs[schema.$ref.split("/").at(-1)], ...schema } : schema;
    const several = (own.anyOf || own.oneOf || []).filter((one) => one.type !== "null");
    return several.length === 1 ? { ...this.resolved(several[0]), description: own.description } : own;
  }

  // Each part is {element, value()}: undefined where nothing is stated.
  part(key, schema, path, given, required) {
    const own = this.resolved(schema), kinds = (own.anyOf || own.oneOf || []).filter((one) => one.type !== "null").map((one) => this.resolved(one));
    const objects = kinds.filter((kind) => kind.properties);
    if (objects.length) return this.choice(key, own, path, given, required, objects[0]);
    if (own.properties) return this.group(key, own, path, given, required);
    if (own.type === "object") return this.named(key, own, path, given);
    if (own.type === "array" && own.items && this.resolved(own.items).properties) return this.list(key, own, path, given);
    return this.field(key, own, kinds, path, given, required);
  }

  object(schema, path, given, required, before = []) {
    const parts = Object.entries(schema.properties).filter(([key]) => key !== "schema")
      .map(([key, own]) => [key, this.part(key, own, [...path, key], given?.[key], (schema.required || []).includes(key))]);
    return {
      element: make("div", { class: "fields" }, ...before, ...parts.map(([, part]) => part.element)),
      value: () => {
        const stated = parts.map(([key, part]) => [key, part.value()]).filter(([, value]) => value !== undefined);
        return stated.length || required ? Object.fromEntries(stated) : undefined;
      },
    };
  }

  help(schema, id) {
    const usual = schema.default, told = usual === undefined || usual === null || typeof usual === "object" || (schema.description || "").includes("default") ? "" : `; default: ${usual}`;
    return make("span", { class: "help", id }, `${schema.description || ""}${told}`);
  }

  group(key, schema, path, given, required) {
    const inner = this.object(schema, path, given, required);
    if (required || (path.length > 1 && !(schema.required || []).length)) return { element: make("fieldset", { class: "group", "data-header-key": path.join("/") }, make("legend", {}, title(key)), this.help(schema), inner.element), value: inner.value };
    // What need not be stated stays folded, and is opened to be stated.
    const fold = make("details", { class: "group", "data-header-key": path.join("/"), open: given !== undefined }, make("summary", {}, title(key)), this.help(schema), inner.element);
    return { element: fold, value: inner.value };
  }

  choice(key, schema, path, given, required, object) {
    const text = this.field(key, schema, [], path, typeof given === "string" ? given : undefined, required);
    const group = this.object(object, path, typeof given === "object" ? given : {}, true);
    const other = make("input", { type: "checkbox" });
    other.checked = given !== null && typeof given === "object";
    const turn = () => { text.element.hidden = other.checked; group.element.hidden = !other.checked; };
    other.addEventListener("change", () => { turn(); this.changed(); });
    turn();
    const box = make("label", { class: "check" }, other, ` ${title(key)}: ${(object.description || "").replace(/\.$/, "").replace(/^./, (c) => c.toLowerCase())}`);
    return { element: make("div", { class: "entry", "data-header-key": path.join("/") }, box, text.element, group.element), value: () => (other.checked ? group.value() : text.value()) };
  }

  field(key, schema, kinds, path, given, required) {
    const id = `import-key-${++count}`, words = schema.enum || (schema.const ? [schema.const] : null) || kinds.flatMap((kind) => kind.enum || (kind.const ? [kind.const] : []));
    const usual = schema.default, logical = schema.type === "boolean" || kinds.some((kind) => kind.type === "boolean");
    let input, read;
    if (words.length || logical) {
      const all = [...words, ...(logical ? ["true", "false"] : [])];
      const none = usual === undefined ? (required ? "choose" : "not stated") : `default (${usual})`;
      input = make("select", {}, make("option", { value: "" }, none), ...all.map((word) => make("option", { value: word }, word)));
      input.value = given === undefined ? "" : String(given);
      read = (text) => (logical && (text === "true" || text === "false") ? text === "true" : text);
    } else {
      const listed = this.lists[path.at(-1)];
      const several = schema.type === "array" || kinds.some((kind) => kind.type === "array");
      const texts = schema.type === "string" || (schema.type === "array" && JSON.stringify(schema).includes('"string"'));
      input = make("input", { autocomplete: "off", spellcheck: "false", inputmode: texts || several ? "text" : "decimal", list: listed ? `${id}-list` : null, placeholder: usual === undefined || usual === null ? null : Array.isArray(usual) ? usual.join(", ") : String(usual) });
      if (given !== undefined && given !== null) input.value = Array.isArray(given) ? given.join(", ") : String(given);
      const fixed = schema.type === "array" || Array.isArray(given);
      read = (text) => {
        if (texts) return schema.type === "array" ? text.split(",").map((part) => part.trim()).filter(Boolean) : text;
        const found = several ? numbers(text) : [number(text)];
        return fixed || found.length > 1 ? found : found[0];
      };
    }
    input.setAttribute("aria-describedby", id);
    input.addEventListener("input", () => { this.unmark(element); this.changed(); });
    const listed = this.lists[path.at(-1)];
    const element = make("div", { class: "stated", "data-header-key": path.join("/"), "data-required": required },
      make("label", {}, `${title(key)}${unit(key) ? ` (${unit(key)})` : ""}${required ? ", required" : ""} `, input),
      listed && input.tagName === "INPUT" ? make("datalist", { id: `${id}-list` }, ...listed.map((word) => make("option", { value: word }))) : "", this.help({ ...schema, default: input.tagName === "SELECT" ? undefined : usual }, id));
    return { element, value: () => (input.value.trim() === "" ? undefined : read(input.value.trim())) };
  }

  // Entries that come and go: items of a list, or values by name.
  entries(key, schema, path, given, made, value) {
    const parts = [], rows = make("div", {});
    const add = (own, at) => {
      const part = made(own, at ?? parts.length);
      parts.push(part);
      const row = make("div", { class: "entry" }, part.element, make("p", {}, make("button", { type: "button", onclick: () => { parts.splice(parts.indexOf(part), 1); row.remove(); this.changed(); } }, "Remove")));
      rows.append(row);
      return row;
    };
    (given || []).forEach((own, i) => add(own, i));
    const button = make("button", { type: "button", onclick: () => { add(undefined).querySelector("input, select").focus(); this.changed(); } }, `Add to ${title(key).toLowerCase()}`);
    const fold = make("details", { class: "group", "data-header-key": path.join("/"), open: Boolean(given && given.length) }, make("summary", {}, title(key)), this.help(schema), rows, button);
    return { element: fold, value: () => (parts.length ? value(parts) : undefined) };
  }

  list(key, schema, path, given) {
    const item = this.resolved(schema.items);
    return this.entries(key, schema, path, given, (own, i) => this.object(item, [...path, i], own, true), (parts) => parts.map((part) => part.value()));
  }

  named(key, schema, path, given) {
    const inner = this.resolved(schema.additionalProperties || {});
    const pair = ([name, own] = ["", undefined]) => {
      const field = make("input", { value: name, autocomplete: "off", spellcheck: "false" });
      field.addEventListener("input", () => this.changed());
      const label = make("label", { class: "stated" }, "Name ", field), at = [...path, name];
      const part = inner.properties ? this.object(inner, at, own, true, [label]) : this.field("value", { ...inner, type: "string", anyOf: undefined }, [], at, own, true);
      return { element: inner.properties ? part.element : make("div", { class: "fields" }, label, part.element), value: () => [field.value.trim(), part.value() ?? (inner.properties ? {} : "")] };
    };
    return this.entries(key, schema, path, given && Object.entries(given), pair, (parts) => Object.fromEntries(parts.map((part) => part.value())));
  }

  // An error stands at the innermost field that its key leads to. Returns whether there is one.
  wrong(key, text) {
    this.right();
    const at = key.join("/");
    const near = [...this.parent.querySelectorAll("[data-header-key]")].filter((e) => at === e.dataset.headerKey || at.startsWith(`${e.dataset.headerKey}/`));
    const element = near.sort((a, b) => b.dataset.headerKey.length - a.dataset.headerKey.length)[0];
    if (!element) return false;
    this.mark(element, text);
    return true;
  }

  mark(element, text) {
    for (let above = element; above; above = above.parentElement.closest("details")) if (above.tagName === "DETAILS") above.open = true;
    element.setAttribute("data-wrong", "");
    const input = element.matches(".stated") && element.querySelector("input, select");
    if (input) input.setAttribute("aria-invalid", "true");
    element.append(make("span", { class: "error help", role: "alert" }, text));
  }

  // What is stated anew is not wrong any more, until it is checked.
  unmark(element) {
    element.querySelector(":scope > .error")?.remove();
    element.removeAttribute("data-wrong");
    element.querySelector("input, select").removeAttribute("aria-invalid");
  }

  right() {
    for (const old of this.parent.querySelectorAll(".error")) old.remove();
    for (const old of this.parent.querySelectorAll("[data-wrong]")) old.removeAttribute("data-wrong");
    for (const old of this.parent.querySelectorAll("[aria-invalid]")) old.removeAttribute("aria-invalid");
  }

  // Marks the required fields that are empty and shown; returns the first.
  missing() {
    this.right();
    const empty = [...this.parent.querySelectorAll("[data-required]")].filter((e) => e.offsetParent !== null && !e.closest("details:not([open])") && e.querySelector("input, select").value.trim() === "");
    for (const element of empty) this.mark(element, "This must be stated.");
    return empty[0];
  }
}
