// The turnable picture of a plan or a run, drawn by drawing/. Base frame in mm, z up; the camera goes round the
// scene's centre. It is put behind those modules into one script.
(() => {
  const scene = JSON.parse(document.getElementById("scene-data").textContent);
  const figure = document.getElementById("scene");
  const canvas = figure.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const said = figure.querySelector("[data-says=posture]");
  const steps = figure.querySelector("[data-of=posture]");
  const size = figure.querySelector("[data-of=factor]"), sized = figure.querySelector("[data-says=factor]");
  if (!pen) return;
  figure.classList.add("alive");

  let view = { ...FIRST_VIEW };
  let chosen = scene.postures.length ? 0 : null; // null: all alike
  let factor = scene.factor; // by which ellipsoids are exaggerated; null: there are none
  let wide = 0, high = 0, colours = null, waiting = false;
  const floor = scene.grid.z || 0;
  const reach = 0.8 * Math.max(1, ...scene.postures.map(({ arm }) => arm.slice(1).reduce((sum, p, i) => sum + apart(arm[i], p), 0)));
  const points = [[0, 0, 0], [0, 0, scene.axis], [0, 0, floor], ...scene.targets.map((t) => t.at), ...scene.outlines.flat()];
  for (const p of scene.postures) points.push(...p.arm, ...p.tool, ...(p.beam || []), ...p.sights.flat());
  for (const t of scene.targets)
    for (const axis of t.axes || []) for (const by of [-scene.factor, scene.factor]) points.push(plus(t.at, times(axis, by)));

  function grid(flat) {
    const [x0, x1, y0, y1] = scene.grid.bounds, step = scene.grid.step;
    for (let x = x0; x <= x1 + step / 2; x += step) flat.line([[x, y0, floor], [x, y1, floor]], 1, colours.line);
    for (let y = y0; y <= y1 + step / 2; y += step) flat.line([[x0, y, floor], [x1, y, floor]], 1, colours.line);
    for (const way of [[1, 0, 0], [0, 1, 0], [0, 0, 1]]) flat.line([[0, 0, 0], times(way, scene.axis)], 2, colours.muted);
  }
  // The other postures as lines: thin where one is chosen.
  function pale(flat, posture) {
    flat.line(posture.arm, chosen === null ? 5 : 3, chosen === null ? colours.muted : colours.line);
    pen.globalAlpha = chosen === null ? 0.8 : 0.35;
    for (const { points: line, tone, dashed } of lineBodies(posture)) flat.line(line, chosen === null ? 1.2 : 0.9, colours[tone], dashed ? [2, 6] : []);
    pen.globalAlpha = 1;
  }
  function strong(flat, posture) {
    const arm = { skeleton: posture.arm, axes: posture.axes };
    flat.add([...armBodies(arm, reach, { below: -floor, kinds: scene.kinds }), ...toolBodies(posture.arm.at(-1), posture.tool[1], posture.beam, reach), ...lineBodies(posture)]);
    flat.flush();
  }
  function disc(x, y, size, colour) {
    pen.beginPath();
    pen.arc(x, y, size, 0, 7);
    pen.fillStyle = colours.panel;
    pen.fill();
    pen.lineWidth = 2;
    pen.strokeStyle = colour;
    pen.stroke();
  }
  // What is not determined is a cross, what is held a square: a shape and a word, not a colour alone.
  const tone = (place) => colours[{ undetermined: "unidentifiable", held: "held" }[place.state] || "identified"];
  function target(camera, place) {
    const [x, y] = camera.seen(place.at), colour = tone(place);
    const strokes = (lines, width) => {
      pen.beginPath();
      for (const [a, b, c, d] of lines) { pen.moveTo(x + a, y + b); pen.lineTo(x + c, y + d); }
      Object.assign(pen, { lineWidth: width, strokeStyle: colour });
      pen.stroke();
    };
    pen.setLineDash([]);
    if (place.state === "undetermined") { strokes([[-7, -7, 7, 7], [-7, 7, 7, -7]], 2.4); return; }
    if (place.state === "held") strokes([[-6, -6, 6, -6], [6, -6, 6, 6], [6, 6, -6, 6], [-6, 6, -6, -6]], 2);
    else if (!place.axes) disc(x, y, 6, colour);
    strokes([[-9, 0, 9, 0], [0, -9, 0, 9]], 1.4);
  }
  // Meridians and parallels of the ellipsoid, its longest axis from pole to pole.
  function ellipsoid(flat, place) {
    const on = (u) => u.reduce((at, by, i) => plus(at, times(place.axes[i], factor * by)), place.at);
    const round = Array.from({ length: 33 }, (_, i) => (i * Math.PI) / 16), [c, s] = [Math.cos, Math.sin];
    pen.globalAlpha = 0.7;
    for (let i = 0; i < 6; i++) {
      const a = (i * Math.PI) / 6;
      flat.line(round.map((t) => on([c(a) * c(t), s(a) * c(t), s(t)])), 1, colours.identified);
    }
    for (const degrees of [-60, -30, 0, 30, 60]) {
      const b = (degrees * Math.PI) / 180;
      flat.line(round.map((t) => on([c(b) * c(t), c(b) * s(t), s(b)])), 1, colours.identified);
    }
    pen.globalAlpha = 1;
  }
  const label = (place) => place.name + ({ undetermined: ": not determined", held: ": held" }[place.state] || "");

  function draw() {
    waiting = false;
    if (!wide || !high) return; // on paper the drawing stands in its place
    const room = { wide, high }, camera = flatCamera(points, room, view, 0.06 * reach), flat = new FlatPen(pen, camera, colours);
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    pen.lineCap = pen.lineJoin = "round";
    grid(flat);
    const own = chosen === null ? null : scene.postures[chosen];
    for (const posture of scene.postures) if (posture !== own) pale(flat, posture);
    for (const outline of scene.outlines) flat.line(outline, 1.6, colours.held);
    if (own) strong(flat, own);
    for (const place of scene.targets) if (place.axes) ellipsoid(flat, place);
    for (const place of scene.targets) target(camera, place);
    const named = (at, text, colour, rank) => {
      const [x, y] = camera.seen(at);
      return { x, y, text, tone: colour, rank, bold: rank < 3 };
    };
    drawLabels(pen, [
      ...scene.targets.map((place) => named(place.at, label(place), tone(place), 1)),
      ...(own ? own.numbers.map((number) => named(number.at, `J${number.text}`, colours.ink, 2)) : []),
      ...["x", "y", "z"].map((name, i) => named([0, 1, 2].map((k) => (k === i ? scene.axis : 0)), name, colours.muted, 3)),
    ], room, colours.panel);
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
    redraw();
  }
  function recolour() {
    colours = coloursOf(document.documentElement);
    redraw();
  }

  function turnBy(right, up) {
    view.azimuth -= right;
    view.elevation = Math.max(-85, Math.min(89, view.elevation + up));
    redraw();
  }
  function zoom(by) {
    view.zoom = Math.max(0.3, Math.min(12, view.zoom * by));
    redraw();
  }
  function reset() {
    view = { ...FIRST_VIEW };
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
    ArrowLeft: () => turnBy(-6, 0), ArrowRight: () => turnBy(6, 0), ArrowUp: () => turnBy(0, 6), ArrowDown: () => turnBy(0, -6),
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
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return;
    const before = held.size === 2 ? spread() : 0;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (held.size === 1) turnBy((event.clientX - last.x) * 0.5, (event.clientY - last.y) * 0.4);
    else if (held.size === 2 && before > 0) zoom(spread() / before);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => held.delete(event.pointerId));

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new ResizeObserver(resize).observe(canvas);
  if (document.fonts) document.fonts.ready.then(redraw);
  recolour();
  resize();
  choose(chosen);
  exaggerate(factor);
})();
