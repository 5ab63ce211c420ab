"""JavaScript of the player for charts, time and user input; in the page it follows the script of the view."""

CONTROLS = r"""// ---- sensors over time, beside the motion
const DASH = [[], [7, 4], [8, 3, 2, 3], [2, 3]], LEFT = 62;
function key(j) {
  const line = document.createElement("span");
  line.className = "key"; line.style.borderTopStyle = j % 4 ? "dashed" : "solid";
  line.style.borderColor = film.colours[j % film.colours.length];
  return line;
}
const strips = film.curves.map((curve, n) => {
  const [box, caption, canvas, title] = ["figure", "figcaption", "canvas", "b"].map(tag => document.createElement(tag));
  const all = curve.values.flat();
  title.textContent = curve.label; caption.append(title);
  const outputs = curve.values.map((_, j) => {
    const one = document.createElement("span"), value = document.createElement("span");
    one.append(...(curve.parts.length > 1 ? [key(j)] : []), value); caption.append(one);
    return value;
  });
  canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", curve.label + " over time");
  box.append(caption, canvas); el("strips").append(box);
  const go = e => { setPlaying(false); const r = canvas.getBoundingClientRect();
    now = T0 + span * Math.max(0, Math.min(1, (e.clientX - r.left - LEFT) / (r.width - LEFT - 10))); show(); };
  canvas.addEventListener("pointerdown", e => { canvas.setPointerCapture(e.pointerId); go(e); });
  canvas.addEventListener("pointermove", e => { if (canvas.hasPointerCapture(e.pointerId)) go(e); });
  let lo = Math.min(...all), hi = Math.max(...all);
  if (hi - lo < 1e-9 * (Math.abs(hi) + Math.abs(lo) + 1e-30)) { lo -= 1; hi += 1; }
  return {curve, canvas, outputs, lo, hi, last: n === film.curves.length - 1};
});
function drawStrip(strip, f) {
  const {curve, canvas, outputs, lo, hi, last} = strip;
  const {c, width} = fitted(canvas, last ? 112 : 92), right = width - 10, top = 6, bottom = 86;
  const X = time => LEFT + (right - LEFT) * (time - T0) / span, Y = v => bottom - (bottom - top) * (v - lo) / (hi - lo);
  const k = f.i * film.fine, m = Math.min(f.j * film.fine, film.times.length - 1);
  c.font = "12px system-ui, sans-serif"; c.lineWidth = 1; c.strokeStyle = "#ddd"; c.setLineDash([]);
  c.strokeRect(LEFT, top, right - LEFT, bottom - top);
  if (lo < 0 && hi > 0) { stroke(c, [[LEFT, Y(0)], [right, Y(0)]]); c.stroke(); }
  c.fillStyle = "#555"; c.textAlign = "right";
  c.fillText(hi.toPrecision(3), LEFT - 5, top + 9); c.fillText(lo.toPrecision(3), LEFT - 5, bottom);
  curve.values.forEach((values, j) => {
    outputs[j].textContent = (curve.parts[j] ? curve.parts[j] + " " : "") + between(values[k], values[m], f.s).toPrecision(3);
    c.strokeStyle = film.colours[j % film.colours.length]; c.lineWidth = 1.6; c.setLineDash(DASH[j % DASH.length]);
    stroke(c, values.map((v, i) => [X(film.times[i]), Y(v)])); c.stroke();
  });
  c.setLineDash([]); c.strokeStyle = INK; c.lineWidth = 1.4; stroke(c, [[X(now), top], [X(now), bottom]]); c.stroke();
  if (!last) return;
  c.fillStyle = "#555"; c.textAlign = "left"; c.fillText(short(T0), LEFT, 104);
  c.textAlign = "right"; c.fillText("time [s]   " + short(T1), right, 104);
}

// ---- time
function show() {
  const f = frame();
  drawView(f);
  for (const strip of strips) drawStrip(strip, f);
  slide.value = String(Math.round(1000 * (now - T0) / span));
  const text = "t = " + now.toFixed(film.digits) + " s";
  el("time").textContent = text; slide.setAttribute("aria-valuetext", text);
}
function setPlaying(on) {
  playing = on; before = 0;
  play.textContent = on ? "\u23f8\ufe0e Pause" : "\u25b6\ufe0e Play"; play.setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) { if (now >= T1) now = T0; requestAnimationFrame(tick); }
}
function tick(stamp) {
  if (!playing) return;
  if (before) now += (stamp - before) / 1000 * Number(el("speed").value);
  before = stamp;
  if (now >= T1 && el("loop").checked) now = T0;
  if (now >= T1) { now = T1; show(); setPlaying(false); return; }
  show(); requestAnimationFrame(tick);
}
play.addEventListener("click", () => setPlaying(!playing));
slide.addEventListener("input", () => { setPlaying(false); now = T0 + span * Number(slide.value) / 1000; show(); });
function step(n) {
  setPlaying(false);
  const f = frame(), i = f.s > 0.999 ? f.j : f.i;
  now = t[Math.max(0, Math.min(t.length - 1, n < 0 && f.s > 0.001 && f.s <= 0.999 ? i : i + n))]; show();
}
el("back").addEventListener("click", () => step(-1));
el("on").addEventListener("click", () => step(1));
for (const id of ["names", "trails", "follow"]) el(id).addEventListener("change", show);
window.addEventListener("resize", show);

// ---- turning, moving and enlarging the view: mouse, fingers, keys
const pointers = new Map();
function turnBy(a, b) { camera.turn += a; camera.tip = Math.max(-1.55, Math.min(1.55, camera.tip + b)); }
function zoomAt(x, y, factor) {  // keeps the point at x, y (px from the left and the top) in place
  const zoom = Math.max(0.1, Math.min(200, camera.zoom * factor)), ratio = zoom / camera.zoom;
  const p = [x - view.clientWidth / 2, y - view.clientHeight / 2];
  camera.x = p[0] - (p[0] - camera.x) * ratio; camera.y = p[1] - (p[1] - camera.y) * ratio; camera.zoom = zoom;
}
function home() { camera = {...HOME}; show(); }
const grip = () => {  // centre of the fingers and their distance, px
  const p = [...pointers.values()], m = [0, 1].map(i => p.reduce((s, q) => s + q[i], 0) / p.length);
  return {m, d: p.length > 1 ? Math.hypot(p[0][0] - p[1][0], p[0][1] - p[1][1]) : 0};
};
const spot = e => { const r = view.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
view.addEventListener("pointerdown", e => { view.setPointerCapture(e.pointerId); pointers.set(e.pointerId, spot(e)); });
view.addEventListener("pointermove", e => {
  if (!pointers.has(e.pointerId)) return;
  const old = grip();
  pointers.set(e.pointerId, spot(e));
  const fresh = grip(), dx = fresh.m[0] - old.m[0], dy = fresh.m[1] - old.m[1];
  if (pointers.size > 1 || film.planar || e.shiftKey || e.buttons === 2) { camera.x += dx; camera.y += dy; }
  else turnBy(-dx * 0.01, dy * 0.01);
  if (old.d > 10 && fresh.d > 10) zoomAt(...fresh.m, fresh.d / old.d);
  show();
});
let tapped = 0;
function lifted(e) {
  if (!pointers.delete(e.pointerId) || e.pointerType !== "touch" || pointers.size) return;
  const p = spot(e), soon = e.timeStamp - tapped.time < 350 && Math.hypot(p[0] - tapped.p[0], p[1] - tapped.p[1]) < 30;
  tapped = soon ? 0 : {time: e.timeStamp, p};
  if (soon) home();
}
for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, lifted);
view.addEventListener("dblclick", home);
view.addEventListener("contextmenu", e => e.preventDefault());
view.addEventListener("wheel", e => {
  e.preventDefault(); zoomAt(...spot(e), Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.0015))); show();
}, {passive: false});
el("reset").addEventListener("click", home);
el("hint").textContent = (film.planar ? "Drag to move the view" : "Drag to turn the view, with two fingers or Shift to move it")
  + "; wheel or two fingers to enlarge; double click to reset. Drag over a chart to go to a time. On the view: Space plays, "
  + (film.planar ? "+ and \u2212 enlarge." : "arrows turn, + and \u2212 enlarge.");
view.addEventListener("keydown", e => {
  const turn = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[e.key];
  const zoom = {"+": 1.2, "=": 1.2, "-": 1 / 1.2}[e.key];
  if (turn && !film.planar) turnBy(...turn);
  else if (zoom) zoomAt(view.clientWidth / 2, view.clientHeight / 2, zoom);
  else if (e.key === "," || e.key === ".") step(e.key === "." ? 1 : -1);
  else if (e.key === " ") setPlaying(!playing);
  else return;
  e.preventDefault(); show();
});
play.disabled = slide.disabled = el("back").disabled = el("on").disabled = t.length < 2;
for (const name in film.bodies) el("follow").add(new Option(name, name));
el("followbox").hidden = !Object.keys(film.bodies).length;
film.trails.forEach(trail => {
  const name = document.createElement("span");
  name.textContent = trail.name; name.style.borderBottom = "3px solid " + trail.colour;
  el("trailbox").append(name);
});
el("trailbox").hidden = !film.trails.length; el("strips").hidden = !film.curves.length;
el("page").classList.toggle("charts", film.curves.length > 0);
show();
"""
