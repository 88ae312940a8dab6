// The turnable picture of a plan or a run. Base frame in mm, z up; the camera goes round the scene's centre.
"use strict";
(() => {
  let scene = JSON.parse(document.getElementById("scene-data").textContent);
  const figure = document.getElementById("scene");
  const canvas = figure.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const said = figure.querySelector("[data-says=posture]");
  const steps = figure.querySelector("[data-of=posture]");
  const size = figure.querySelector("[data-of=factor]"), sized = figure.querySelector("[data-says=factor]");
  if (!pen) return;
  figure.classList.add("alive");

  const [azimuth, elevation] = scene.view;
  const start = { azimuth, elevation, zoom: 1 };
  let camera = { ...start };
  let chosen = scene.postures.length ? 0 : null; // null: all alike
  let factor = scene.factor; // by which ellipsoids are exaggerated; null: there are none
  let wide = 0, high = 0, scale = 1, colours = {}, basis = null, middle = [0, 0], waiting = false;
  const radians = (degrees) => (degrees * Math.PI) / 180;

  function aim(view) {
    const a = radians(view.azimuth), e = radians(view.elevation);
    const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
    basis = { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], towards: [ce * ca, ce * sa, se] };
  }
  const along = (axis, p) =>
    axis[0] * (p[0] - scene.centre[0]) + axis[1] * (p[1] - scene.centre[1]) + axis[2] * (p[2] - scene.centre[2]);
  // A mild perspective: the eye is five radii away.
  function seen(p) {
    const near = along(basis.towards, p), eye = 5 * scene.radius;
    const size = eye / (eye - near);
    return { x: along(basis.right, p) * size, y: -along(basis.up, p) * size, near };
  }
  function at(p) {
    const q = seen(p);
    const by = scale * camera.zoom;
    return [wide / 2 + (q.x - middle[0]) * by, high / 2 + (q.y - middle[1]) * by, q.near];
  }

  // As large as the first view allows, with room for the names.
  function fit() {
    aim(start);
    const points = [[0, 0, 0], [0, 0, scene.axis], [0, 0, scene.grid.z || 0], ...scene.targets.map((t) => t.at), ...(scene.extent || [])];
    for (const p of scene.postures) points.push(...p.arm, ...p.tool, ...(p.beam || []), ...(p.sights || []).flat());
    points.push(...(scene.outlines || []).flat());
    for (const t of scene.targets)
      for (const axis of t.axes || []) for (const by of [-scene.factor, scene.factor]) points.push(t.at.map((v, i) => v + by * axis[i]));
    const flat = points.map(seen), xs = flat.map((q) => q.x), ys = flat.map((q) => q.y);
    const [left, right] = [xs.reduce((a, b) => Math.min(a, b)), xs.reduce((a, b) => Math.max(a, b))];
    const [top, bottom] = [ys.reduce((a, b) => Math.min(a, b)), ys.reduce((a, b) => Math.max(a, b))];
    middle = [(left + right) / 2, (top + bottom) / 2];
    scale = Math.min((wide - 90) / Math.max(right - left, 1), (high - 70) / Math.max(bottom - top, 1));
  }

  function line(points, width, colour, dash = []) {
    pen.beginPath();
    for (const p of points) pen.lineTo(p[0], p[1]);
    pen.lineWidth = width;
    pen.strokeStyle = colour;
    pen.setLineDash(dash);
    pen.stroke();
  }
  const font = (bold) => `${bold ? "700 " : ""}13px "IBM Plex Sans", system-ui, sans-serif`;
  function text(words, x, y, colour, bold = false) {
    pen.font = font(bold);
    pen.setLineDash([]);
    pen.lineWidth = 4;
    pen.strokeStyle = colours.panel;
    pen.strokeText(words, x, y);
    pen.fillStyle = colour;
    pen.fillText(words, x, y);
  }

  function floor() {
    const [x0, x1, y0, y1] = scene.grid.bounds, step = scene.grid.step, z = scene.grid.z || 0;
    for (let x = x0; x <= x1 + step / 2; x += step) line([at([x, y0, z]), at([x, y1, z])], 1, colours.line);
    for (let y = y0; y <= y1 + step / 2; y += step) line([at([x0, y, z]), at([x1, y, z])], 1, colours.line);
    if (z) line([at([0, 0, z]), at([0, 0, 0])], 2, colours.muted); // the arm's own base
    ["x", "y", "z"].forEach((name, i) => {
      const end = [0, 0, 0];
      end[i] = scene.axis;
      const tip = at(end);
      line([at([0, 0, 0]), tip], 2, colours.muted);
      text(name, tip[0] + 4, tip[1] - 4, colours.muted);
    });
  }

  // Every piece of the picture with its nearness: the far ones are drawn first (painter's order).
  function pieces(posture, strong) {
    const found = [];
    const link = (a, b, draw) => found.push({ near: (a[2] + b[2]) / 2, draw });
    const arm = posture.arm.map(at);
    const shown = strong ? 1 : chosen === null ? 0.6 : 0.2;
    const thick = (strong ? 9 : 5) * Math.min(1, wide / 560);
    for (let i = 0; i + 1 < arm.length; i++) {
      const [a, b] = [arm[i], arm[i + 1]];
      if (Math.hypot(a[0] - b[0], a[1] - b[1]) < 0.5) continue;
      // Thinner towards the wrist; a halo shows which of two crossing links is in front.
      const width = thick * (1 - (0.45 * i) / arm.length);
      link(a, b, () => {
        pen.globalAlpha = shown;
        if (strong) line([a, b], width + 4, colours.panel);
        line([a, b], width, strong ? colours.ink : colours.muted);
      });
    }
    const tool = posture.tool.map(at);
    link(tool[0], tool[1], () => {
      pen.globalAlpha = shown;
      line(tool, thick / 2.2, strong ? colours.ink : colours.muted);
    });
    for (const sight of (posture.sights || []).map((s) => s.map(at)))
      link(sight[0], sight[1], () => {
        pen.globalAlpha = strong ? 1 : chosen === null ? 0.45 : 0.2;
        line(sight, strong ? 2 : 0.9, colours.identified);
      });
    if (posture.beam) {
      const beam = posture.beam.map(at);
      link(beam[0], beam[1], () => {
        pen.globalAlpha = strong ? 1 : chosen === null ? 0.8 : 0.35;
        const dash = posture.reaches ? [] : [2, 6];
        line(beam, strong ? 2.4 : 1.2, posture.reaches ? colours.identified : colours.weak, dash);
      });
    }
    return found;
  }
  function disc(x, y, size, colour) {
    pen.globalAlpha = 1;
    pen.beginPath();
    pen.arc(x, y, size, 0, 7);
    pen.fillStyle = colours.panel;
    pen.fill();
    pen.lineWidth = 2;
    pen.setLineDash([]);
    pen.strokeStyle = colour;
    pen.stroke();
  }
  function joint(number) {
    const [x, y] = at(number.at);
    disc(x, y, wide < 560 ? 3 : 4.5, colours.ink);
  }
  // What is not determined is a cross, what is held a square: a shape and a word, not a colour alone.
  const tone = (place) => colours[{ undetermined: "unidentifiable", held: "held" }[place.state] || "identified"];
  function target(place) {
    const [x, y] = at(place.at), colour = tone(place);
    pen.globalAlpha = 1;
    if (place.state === "undetermined") {
      line([[x - 7, y - 7], [x + 7, y + 7]], 2.4, colour);
      line([[x - 7, y + 7], [x + 7, y - 7]], 2.4, colour);
      return;
    }
    if (place.state === "held") line([[x - 6, y - 6], [x + 6, y - 6], [x + 6, y + 6], [x - 6, y + 6], [x - 6, y - 6]], 2, colour);
    else if (!place.axes) disc(x, y, 6, colour);
    line([[x - 9, y], [x + 9, y]], 1.4, colour);
    line([[x, y - 9], [x, y + 9]], 1.4, colour);
  }
  // Meridians and parallels of the ellipsoid, its longest axis from pole to pole.
  function ellipsoid(place) {
    const on = (u) => at([0, 1, 2].map((i) => place.at[i] + factor * (u[0] * place.axes[0][i] + u[1] * place.axes[1][i] + u[2] * place.axes[2][i])));
    const round = Array.from({ length: 33 }, (_, i) => (i * Math.PI) / 16);
    const [c, s] = [Math.cos, Math.sin];
    pen.globalAlpha = 0.7;
    for (let i = 0; i < 6; i++) {
      const a = (i * Math.PI) / 6;
      line(round.map((t) => on([c(a) * c(t), s(a) * c(t), s(t)])), 1, colours.identified);
    }
    for (const b of [-60, -30, 0, 30, 60].map(radians))
      line(round.map((t) => on([c(b) * c(t), c(b) * s(t), s(b)])), 1, colours.identified);
  }
  // A frame's axes, a joint's axis, an obstacle: what a page asks for besides.
  function frame(own) {
    const from = at(own.at);
    pen.globalAlpha = 1;
    own.axes.forEach((axis, i) => {
      const tip = at(own.at.map((v, k) => v + 0.5 * scene.axis * axis[k]));
      line([from, tip], 2.4, colours.held);
      text("xyz"[i], tip[0] + 3, tip[1] - 3, colours.held);
    });
    text(own.name, from[0] - 10, from[1] + 20, colours.held);
  }
  const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
  const middleOf = (box) => box.min.map((v, i) => (v + box.max[i]) / 2);
  function obstacle(box) {
    const corners = Array.from({ length: 8 }, (_, k) => at([0, 1, 2].map((i) => (k & (4 >> i) ? box.max : box.min)[i])));
    const colour = box.touched ? colours.unidentifiable : colours.muted;
    pen.globalAlpha = 1;
    for (const [a, b] of EDGES) line([corners[a], corners[b]], box.touched ? 2.4 : 1.4, colour, box.touched ? [] : [6, 3]);
    const [x, y] = at(middleOf(box));
    if (scene.movable) disc(x, y, 5, colour);
    text(box.name + (box.touched ? ": touched" : ""), x + 10, y + 4, colour, true);
  }
  // Triangles in one grey each, by how they face the light; the far ones first.
  const LIGHT = [0.35, -0.45, 0.82];
  function solid(posture) {
    const found = [];
    for (const mesh of posture.meshes) {
      const flat = mesh.vertices.map(at);
      mesh.faces.forEach((face, i) => {
        const [a, b, c] = face.map((k) => flat[k]);
        found.push({ near: a[2] + b[2] + c[2], a, b, c, shade: mesh.shades[i] });
      });
    }
    pen.globalAlpha = 1;
    pen.setLineDash([]);
    pen.lineWidth = 0.7;
    for (const { a, b, c, shade } of found.sort((p, q) => p.near - q.near)) {
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      pen.lineTo(c[0], c[1]);
      pen.closePath();
      pen.fillStyle = pen.strokeStyle = colours.greys[Math.round(15 * shade)];
      pen.fill();
      pen.stroke();
    }
  }
  // How a triangle faces the light, 0 to 1, does not depend on where it is seen from: found once a scene.
  function shaded(mesh) {
    mesh.shades ??= mesh.faces.map((face) => {
      const [a, b, c] = face.map((k) => mesh.vertices[k]);
      const u = b.map((v, i) => v - a[i]), w = c.map((v, i) => v - a[i]);
      const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const dot = n[0] * LIGHT[0] + n[1] * LIGHT[1] + n[2] * LIGHT[2];
      return Math.abs(dot) / (Math.hypot(...n) * Math.hypot(...LIGHT) || 1);
    });
  }
  const label = (place) => place.name + ({ undetermined: ": not determined", held: ": held" }[place.state] || "");

  function draw() {
    waiting = false;
    aim(camera);
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    pen.lineCap = pen.lineJoin = "round";
    pen.globalAlpha = 1;
    floor();
    const others = scene.postures.flatMap((p, i) => (i === chosen ? [] : pieces(p, false)));
    const own = chosen === null ? [] : pieces(scene.postures[chosen], true);
    const shown = chosen === null ? {} : scene.postures[chosen];
    (scene.boxes || []).forEach(obstacle);
    (scene.outlines || []).forEach((outline) => line(outline.map(at), 1.6, colours.held));
    if (shown.meshes) solid(shown);
    for (const list of [others, own])
      for (const piece of list.sort((a, b) => a.near - b.near)) piece.draw();
    for (const axis of shown.axes || []) line(axis.map(at), 1.6, colours.weak, [10, 4, 2, 4]);
    (shown.frames || []).forEach(frame);
    if (chosen !== null) scene.postures[chosen].numbers.forEach(joint);
    scene.targets.filter((t) => t.axes).forEach(ellipsoid);
    scene.targets.forEach(target);
    pen.globalAlpha = 1;
    for (const t of scene.targets) {
      const [x, y] = at(t.at);
      pen.font = font(true);
      const long = pen.measureText(label(t)).width;
      const from = x + 12 + long > wide ? Math.max(4, x - 12 - long) : x + 12;
      text(label(t), from, y + 18, tone(t), true);
    }
    if (chosen !== null)
      for (const number of scene.postures[chosen].numbers) {
        const p = at(number.at);
        text(number.text, p[0] + 10, p[1] - 8, colours.ink, true);
      }
  }
  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function resize() {
    wide = canvas.clientWidth;
    high = canvas.clientHeight;
    canvas.width = Math.round(wide * devicePixelRatio);
    canvas.height = Math.round(high * devicePixelRatio);
    fit();
    redraw();
  }
  function recolour() {
    const style = getComputedStyle(document.documentElement);
    for (const role of ["ink", "muted", "line", "panel", "identified", "weak", "unidentifiable", "held"])
      colours[role] = style.getPropertyValue(`--${role}`).trim();
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    colours.greys = Array.from({ length: 16 }, (_, k) => { const v = Math.round((dark ? 60 : 120) + (dark ? 7 : 6) * k); return `rgb(${v} ${v} ${v})`; });
    redraw();
  }

  function turn(right, up) {
    camera.azimuth -= right;
    camera.elevation = Math.max(-85, Math.min(89, camera.elevation + up));
    redraw();
  }
  function zoom(factor) {
    camera.zoom = Math.max(0.3, Math.min(12, camera.zoom * factor));
    redraw();
  }
  function reset() {
    camera = { ...start };
    redraw();
  }
  function choose(which) {
    const count = scene.postures.length;
    chosen = which === null ? null : ((which % count) + count) % count;
    said.textContent = chosen === null ? `all ${count}` : scene.postures[chosen].name;
    if (steps && chosen !== null) {
      steps.value = chosen;
      steps.setAttribute("aria-valuetext", said.textContent);
    }
    figure.querySelector("[data-do=all]").setAttribute("aria-pressed", String(chosen === null));
    figure.dispatchEvent(new CustomEvent("chosen", { detail: chosen }));
    redraw();
  }

  // To two digits, as the slider is not finer, and in words.
  function exaggerate(by) {
    if (!size) return;
    const most = 10 ** size.max;
    factor = Number(Math.max(1, Math.min(most, by)).toPrecision(2));
    size.value = Math.log10(factor);
    sized.textContent = factor === 1 ? "drawn at its true size" : `drawn ${factor} times its true size`;
    size.setAttribute("aria-valuetext", sized.textContent);
    redraw();
  }

  const acts = {
    previous: () => choose(chosen === null ? -1 : chosen - 1),
    next: () => choose(chosen === null ? 0 : chosen + 1),
    all: () => choose(chosen === null ? 0 : null),
    nearer: () => zoom(1.25),
    farther: () => zoom(0.8),
    reset,
  };
  for (const button of figure.querySelectorAll("[data-do]"))
    button.addEventListener("click", () => acts[button.dataset.do]());

  if (steps) steps.addEventListener("input", () => choose(Number(steps.value)));
  if (size) size.addEventListener("input", () => exaggerate(10 ** size.value));

  const keys = {
    ArrowLeft: () => turn(-6, 0), ArrowRight: () => turn(6, 0), ArrowUp: () => turn(0, 6), ArrowDown: () => turn(0, -6),
    "+": acts.nearer, "=": acts.nearer, "-": acts.farther, n: acts.next, p: acts.previous, a: acts.all, 0: reset,
    "[": () => exaggerate(factor / 2), "]": () => exaggerate(factor * 2),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!Object.hasOwn(keys, event.key) || event.ctrlKey || event.metaKey || event.altKey) return;
    keys[event.key]();
    event.preventDefault();
  });
  // The wheel scrolls the page until the picture was clicked, so that nobody gets stuck in it.
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;
    zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)));
    event.preventDefault();
  }, { passive: false });

  const held = new Map(); // fingers (or the mouse) on the picture
  const apart = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  // What a page lets its reader move, a target or an obstacle, moves in the plane of the picture.
  const movable = () => !scene.movable ? [] : [...scene.targets.map((t) => ({ kind: "target", name: t.name, at: t.at })),
    ...(scene.boxes || []).map((box, i) => ({ kind: "box", name: i, at: middleOf(box) }))];
  let grabbed = null;
  function under(event) {
    const place = canvas.getBoundingClientRect(), reach = event.pointerType === "mouse" ? 12 : 24;
    const found = movable().map((own) => {
      const [x, y] = at(own.at);
      return { ...own, far: Math.hypot(x - event.clientX + place.left, y - event.clientY + place.top) };
    });
    return found.filter((own) => own.far <= reach).sort((a, b) => a.far - b.far)[0] || null;
  }
  function drag(right, down) {
    const size = scale * camera.zoom * (5 * scene.radius) / (5 * scene.radius - along(basis.towards, grabbed.at));
    grabbed.at = grabbed.at.map((v, i) => v + (right * basis.right[i] - down * basis.up[i]) / size);
    figure.dispatchEvent(new CustomEvent("moved", { detail: { kind: grabbed.kind, name: grabbed.name, at: grabbed.at } }));
  }
  canvas.addEventListener("pointerdown", (event) => {
    grabbed = held.size ? null : under(event);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) {
      if (scene.movable) canvas.style.cursor = under(event) ? "move" : "";
      return;
    }
    const before = held.size === 2 ? apart() : 0;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (grabbed) drag(event.clientX - last.x, event.clientY - last.y);
    else if (held.size === 1) turn((event.clientX - last.x) * 0.5, (event.clientY - last.y) * 0.4);
    else if (held.size === 2 && before > 0) zoom(apart() / before);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => {
      held.delete(event.pointerId);
      grabbed = null;
    });

  // A page whose scene changes (the app) says so: the new scene, which posture is chosen, whether to fit it in anew.
  figure.addEventListener("scene", (event) => {
    scene = event.detail.scene;
    for (const posture of scene.postures) (posture.meshes || []).forEach(shaded);
    if (event.detail.fit) fit();
    choose(scene.postures.length ? event.detail.chosen : null);
  });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new ResizeObserver(resize).observe(canvas);
  if (document.fonts) document.fonts.ready.then(redraw);
  recolour();
  resize();
  choose(chosen);
  exaggerate(factor);
})();
