// Which column of a table is which joint, with what unit and sign; live against the limits of the joints.
import { latest, post } from "/page/parts/api.js";
import { by, fill, fixed, make, say, withUnit } from "/page/parts/dom.js";

export const layout = {}; // header_row, delimiter, decimal, where they were stated otherwise than found
let state = null; // {columns, units, lengths, reversed, j3}
let source = null; // {files, found, robot, beside}
let answer = null, redo = () => {}, changed = () => {};

export const mapped = () => state;

const ask = latest(
  async () => {
    const asked = source;
    if (asked === null) return null;
    const found = await post("/api/columns", { files: asked.files, robot: asked.robot, beside: asked.beside, ...layout, ...state.columns && { columns: state.columns }, units: state.units || null, lengths: state.lengths || null, reversed_joints: state.reversed, j3: state.j3 || null });
    return asked === source ? found : null;
  },
  (found) => {
    answer = found;
    wrong("");
    if (state.columns === null) state.columns = found.joints.map(() => null);
    render();
    changed();
  },
  (error) => {
    wrong(error.text);
    const [where, which] = error.key;
    const cell = where === "columns" && by("import-mapper").querySelector(`[data-joint="${which}"] select`);
    if (cell) cell.setAttribute("aria-invalid", "true");
    else if (where !== "columns") fill(by("import-mapper"), []);
    changed();
  },
);

function wrong(text) {
  by("import-read-fault").textContent = text;
  by("import-read-fault").hidden = !text;
}

const edit = (then) => { then(); ask(); };

// Shows the mapper for tables, robot and layout; what was stated for another robot or other columns is dropped.
export function show(given, looked, told) {
  const same = source && JSON.stringify([source.found.columns, source.robot]) === JSON.stringify([given.found.columns, given.robot]);
  source = given;
  redo = looked;
  changed = told;
  if (!same || state === null) {
    state = { columns: null, units: "", lengths: "", reversed: [], j3: "" };
    answer = null;
    fill(by("import-mapper"), []);
  }
  layoutFields();
  ask();
}

export function hide() {
  source = null;
  wrong("");
  for (const id of ["import-layout", "import-proposals", "import-mapper"]) fill(by(id), []);
}

function select(label, words, value, told, none) {
  const input = make("select", {}, ...(none ? [make("option", { value: "" }, none)] : []), ...words.map(([word, text]) => make("option", { value: word }, text)));
  input.value = value;
  input.addEventListener("change", () => told(input.value));
  return make("label", {}, label, " ", input);
}

function layoutFields() {
  const own = source.found.layout;
  const again = (key) => (value) => { layout[key] = value; redo(); };
  const signs = [[",", "comma"], [";", "semicolon"], ["\t", "tab"], [" ", "blank"]];
  if (!signs.some(([sign]) => sign === own.delimiter)) signs.push([own.delimiter, own.delimiter]);
  fill(by("import-layout"), [
    select("Header row", [["true", "the first row names the columns"], ["false", "none"]], String(own.header_row), (value) => again("header_row")(value === "true")),
    select("Delimiter", signs, own.delimiter, again("delimiter")),
    select("Decimal sign", [[".", "point"], [",", "comma"]], own.decimal, again("decimal")),
    make("p", { class: "muted help" }, Object.keys(layout).length ? "As you state it." : `Found: ${own.why.join("; ")}.`),
  ]);
}

// A proposal, or why there is none, and what takes it.
function proposal(text, take, decided = true) {
  return make("div", { class: take ? "proposed" : "" }, make("span", {}, text), take ? make("button", { type: "button", onclick: () => edit(take) }, decided ? "Take it" : "Take it unproved") : "");
}

const WAY = { deg: "degrees", rad: "radians", mm: "millimetres", m: "metres", link: "link 2", ground: "the ground" };

function proposals() {
  const rows = [];
  const { columns, units, lengths, j3 } = answer;
  if (columns && JSON.stringify(columns.choice) !== JSON.stringify(state.columns)) rows.push(proposal(`Proposed columns: ${columns.choice.join(", ")}, because ${columns.why}. The order is not tested by this.`, () => { state.columns = [...columns.choice]; }, false));
  for (const [key, of, found] of [["units", "Unit of the angles", units], ["lengths", "Unit of prismatic joints", lengths], ["j3", "Joint 3", j3]]) {
    if (!found) continue;
    const open = found.choice && found.choice !== state[key];
    const text = found.choice ? `${of}: ${WAY[found.choice]} ${found.decided ? "by the limits" : "perhaps"}: ${found.why}.` : `${of}: ${found.why}.`;
    rows.push(proposal(text, open ? () => { state[key] = found.choice; } : null, found.decided));
  }
  fill(by("import-proposals"), rows);
}

function bar(joint) {
  const box = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  box.setAttribute("viewBox", "0 0 100 12");
  box.setAttribute("preserveAspectRatio", "none");
  box.setAttribute("aria-hidden", "true");
  const low = Math.min(joint.lower, joint.seen[0]), high = Math.max(joint.upper, joint.seen[1]);
  const place = (value) => (100 * (value - low)) / (high - low || 1);
  const part = (kind, from, to, y, height) => {
    const rect = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [name, value] of Object.entries({ class: kind, x: place(from), y, width: Math.max(1, place(to) - place(from)), height })) rect.setAttribute(name, value);
    box.append(rect);
  };
  part("limits", joint.lower, joint.upper, 0, 12);
  part(joint.outside ? "range out" : "range", ...joint.seen, 3, 6);
  return box;
}

const range = ([low, high], unit) => `${fixed(low, 2)} to ${withUnit(fixed(high, 2), unit)}`;

function row(joint, i) {
  const chosen = make("select", { "aria-label": `Column of J${i + 1}` }, make("option", { value: "" }, "not stated"), ...source.found.columns.map((c) => make("option", { value: c.stated, disabled: c.lowest === null }, c.lowest === null ? `${c.name} (no number in line ${c.line})` : c.name)));
  chosen.value = state.columns[i] || "";
  chosen.addEventListener("change", () => edit(() => { state.columns[i] = chosen.value || null; }));
  const sign = make("input", { type: "checkbox", "aria-label": `J${i + 1}: reverse the sign` });
  sign.checked = state.reversed.includes(i + 1);
  sign.addEventListener("change", () => edit(() => { reverse(i + 1, sign.checked); }));
  const found = joint.sign, wish = found && found.choice && (found.choice === "reversed") !== sign.checked;
  return make("tr", { "data-joint": i },
    make("th", { scope: "row" }, `J${i + 1}`, make("small", {}, joint.name)),
    make("td", { "data-head": "column" }, chosen),
    make("td", { "data-head": "sign" }, make("label", { class: "check" }, sign, " reversed")),
    make("td", { class: "right", "data-head": "seen" }, joint.seen ? range(joint.seen, joint.unit) : joint.recorded ? `${range(joint.recorded, "1")} recorded` : "—"),
    make("td", { class: "right", "data-head": "limits" }, range([joint.lower, joint.upper], joint.unit)),
    make("td", { class: joint.outside ? "beyond" : "", "data-head": "against the limits" }, joint.seen ? bar(joint) : "", joint.outside === null ? "" : joint.outside ? `${joint.outside} of ${answer.rows} rows outside` : "all within"),
    make("td", { class: wish ? "proposed" : "", "data-head": "what the limits say" }, found ? make("small", {}, found.choice || !found.outside.recorded ? `Sign ${found.why}` : "Neither sign fits") : "", wish ? make("button", { type: "button", onclick: () => edit(() => reverse(i + 1, found.choice === "reversed")) }, found.choice === "reversed" ? "Reverse it" : "Do not reverse") : ""));
}

export function reverse(joint, on) {
  state.reversed = state.reversed.filter((other) => other !== joint);
  if (on) state.reversed = [...state.reversed, joint].sort((a, b) => a - b);
}

export function swap(a, b) {
  [state.columns[a - 1], state.columns[b - 1]] = [state.columns[b - 1], state.columns[a - 1]];
}

export const refresh = () => ask();

function render() {
  const focus = document.activeElement && by("import-mapper").contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
  proposals();
  const slides = answer.joints.some((joint) => joint.unit === "mm"), turns = answer.joints.some((joint) => joint.unit === "deg");
  const pick = (key) => (value) => edit(() => { state[key] = value; });
  const head = ["joint", "column", "sign", "seen", "limits", "against the limits", "what the limits say"];
  const outside = answer.joints.filter((joint) => joint.outside).length;
  fill(by("import-mapper"), [
    make("div", { class: "fields" },
      turns ? select("Unit of the angles", [["deg", "degrees"], ["rad", "radians"]], state.units, pick("units"), "choose") : "",
      slides ? select("Unit of prismatic joints", [["mm", "millimetres"], ["m", "metres"]], state.lengths, pick("lengths"), "choose") : "",
      select("Joint 3 is counted from", [["link", "link 2"], ["ground", "the ground"]], state.j3, pick("j3"), "as the robot file states")),
    make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Columns as joints" },
      make("table", { class: "mapper" }, make("caption", {}, `${answer.whole ? `All ${answer.rows} rows` : `The first ${answer.rows} rows; the rest is checked at the import`}, robot ${answer.robot}.`),
        make("thead", {}, make("tr", {}, ...head.map((text, i) => make("th", { scope: "col", class: i === 3 || i === 4 ? "right" : "" }, text)))),
        make("tbody", {}, ...answer.joints.map(row)))),
  ]);
  if (focus) by("import-mapper").querySelector(`[aria-label="${focus}"]`)?.focus();
  say(outside ? `${outside} joints outside their limits` : "");
}

// The words that say so to the command.
export function words() {
  const own = source.found.layout;
  const stated = layout.delimiter ? [`--delimiter=${own.delimiter}`] : [];
  if (own.decimal !== ".") stated.push(`--decimal=${own.decimal}`);
  if (own.header_row) stated.push("--header-row");
  if (state.units) stated.push(`--units=${state.units}`);
  if (state.lengths) stated.push(`--lengths=${state.lengths}`);
  if (state.columns) stated.push(`--columns=${state.columns.join(",")}`);
  if (state.reversed.length) stated.push(`--reversed=${state.reversed.map((n) => `j${n}`).join(",")}`);
  if (state.j3) stated.push(`--j3=${state.j3}`);
  return stated;
}

// What is not stated yet, in words; null where all is.
export function open() {
  if (!state || !state.columns || state.columns.some((column) => column === null)) return "state the column of each joint";
  if (answer.joints.some((joint) => joint.unit === "deg") && !state.units) return "state the unit of the angles";
  if (answer.joints.some((joint) => joint.unit === "mm") && !state.lengths) return "state the unit of the prismatic joints";
  return null;
}
