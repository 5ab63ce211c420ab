"""The HTML of the player; `player.page` replaces the fields between @ signs."""

PAGE = r"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@NAME@</title>
<link rel="icon" href="data:,">
<style>
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 12px 16px; max-width: 1100px; font: 15px/1.4 system-ui, sans-serif; color: #222;
       background: #fff; }
h1 { font-size: 1.15rem; margin: 0 0 8px; overflow-wrap: anywhere; }
canvas { display: block; width: 100%; }
#view { border: 1px solid #ccc; border-radius: 6px; }
#view.space { cursor: grab; touch-action: pan-y; }
#bar { display: flex; flex-wrap: wrap; gap: 8px 12px; align-items: center; margin: 10px 0; }
#slide { flex: 1 1 160px; min-width: 120px; }
button, select { font: inherit; padding: 6px 12px; border: 1px solid #777; border-radius: 6px; background: #f4f4f4; color: #222; }
#play { min-width: 6em; font-weight: 600; }
:is(button, select, input, canvas):focus-visible { outline: 3px solid #0072B2; outline-offset: 1px; }
label { display: inline-flex; flex-wrap: wrap; gap: 6px; align-items: center; }
label[hidden] { display: none; }
output { font-variant-numeric: tabular-nums; min-width: 8em; }
#hint { color: #555; font-size: .87rem; margin: 6px 0; }
</style>
</head>
<body>
<h1>@NAME@</h1>
<canvas id="view" tabindex="0" role="img" aria-label="Moving drawing of @NAME@"></canvas>
<div id="bar">
<button id="play" type="button" aria-label="Play">&#9654; Play</button>
<input id="slide" type="range" min="0" max="1000" value="0" step="1" aria-label="Time">
<output id="time" for="slide"></output>
<label>Speed <select id="speed">@SPEEDS@</select></label>
<label><input id="names" type="checkbox" checked> Names</label>
<label id="trailbox" hidden><input id="trails" type="checkbox" checked> Trails:</label>
<button id="reset" type="button" hidden>Reset view</button>
</div>
<canvas id="strip" role="img" aria-label="Sensors over time" hidden></canvas>
<p id="hint"></p>
<script id="film" type="application/json">@DATA@</script>
<script>
"use strict";
const film = JSON.parse(document.getElementById("film").textContent);
const el = id => document.getElementById(id);
const view = el("view"), strip = el("strip"), play = el("play"), slide = el("slide");
const t = film.t, T0 = t[0], T1 = t[t.length - 1], span = T1 - T0 || 1;
const INK = "#222222", HOME = {turn: -0.96, tip: 0.38};
let now = T0, playing = false, before = 0, camera = {...HOME}, drag = null;

// ---- vectors, in m
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => a.map(x => x * s);
const unit = a => scaled(a, 1 / (Math.hypot(...a) || 1));
const mixed = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));

// ---- interpolation: frame i, and the share s of the time to the next frame
function frame() {
  let lo = 0, hi = t.length - 1;
  while (hi - lo > 1) { const mid = (lo + hi) >> 1; if (t[mid] <= now) lo = mid; else hi = mid; }
  return {i: lo, j: hi, s: hi > lo ? Math.min(1, Math.max(0, (now - t[lo]) / (t[hi] - t[lo]))) : 0};
}
const at = (list, f) => list.length === 1 ? list[0] : list[f.s < 0.5 ? f.i : f.j];
function pose(name, f) {
  const b = film.bodies[name];
  return {r: scaled(at(b.r, f), film.unit), R: scaled(at(b.R, f), film.grain)};
}
function carried(p, x) {
  const R = p.R, r = p.r;
  return [0, 1, 2].map(i => r[i] + R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2]);
}
function pointsOf(shape, poses, f) {
  const local = at(shape.points, f).map(p => scaled(p, film.unit));
  return shape.body ? local.map(p => carried(poses[shape.body], p)) : local;
}

// ---- the camera: directions to the right and up in the picture, and towards the viewer
const g = Math.hypot(...film.gravity), up = !film.planar && g ? scaled(film.gravity, -1 / g) : [0, 0, 1];
function eye() {
  if (film.planar) return {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]};
  const side = unit(Math.abs(up[2]) > 0.9 ? [1, 0, 0] : cross(up, [0, 0, 1])), fore = cross(up, side);
  const flat = side.map((v, i) => Math.cos(camera.turn) * v + Math.sin(camera.turn) * fore[i]);
  const z = flat.map((v, i) => Math.cos(camera.tip) * v + Math.sin(camera.tip) * up[i]);
  const x = unit(cross(up, z));
  return {x, y: cross(z, x), z};
}
const middle = film.low.map((v, i) => (v + film.high[i]) / 2), extent = film.high.map((v, i) => v - film.low[i]);
const radius = Math.hypot(...extent) / 2 || 1;

function fitted(canvas, height) {
  const width = canvas.clientWidth, ratio = window.devicePixelRatio || 1;
  canvas.style.height = height + "px";
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  return {c, width, height};
}

function lens(width, height) {
  const e = eye(), pad = film.planar ? 34 : 20;
  const w = film.planar ? extent[0] : 1.75 * radius, h = film.planar ? extent[1] : 1.75 * radius;
  const k = Math.min((width - 2 * pad) / (w || 1e-9), (height - 2 * pad) / (h || 1e-9));
  const see = p => {
    const d = p.map((v, i) => v - middle[i]);
    return [width / 2 + k * dot(d, e.x), height / 2 - k * dot(d, e.y), dot(d, e.z)];
  };
  return {see, k, e};
}

function stroke(c, pts, closed) {
  c.beginPath();
  pts.forEach((p, i) => i ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1]));
  if (closed) c.closePath();
}
function paint(c, kind, colour, pts) {
  const look = film.looks[kind], scale = 1.25;
  c.lineCap = c.lineJoin = "round";
  c.strokeStyle = colour; c.lineWidth = look.width * scale; c.setLineDash(look.dash);
  if (look.marker) return mark(c, look, colour, pts[0], look.size * scale / 2);
  if (look.fill) { stroke(c, pts, true); c.globalAlpha = look.fill; c.fillStyle = colour; c.fill(); c.globalAlpha = 1; }
  stroke(c, pts, false);
  if (look.casing) { c.strokeStyle = INK; c.lineWidth += 2; c.stroke(); c.strokeStyle = colour; c.lineWidth -= 2; }
  c.stroke(); c.setLineDash([]);
}
function mark(c, look, colour, p, r) {
  c.setLineDash([]); c.beginPath();
  if (look.marker === "o") c.arc(p[0], p[1], r, 0, 7);
  else if (look.marker === "s") c.rect(p[0] - r, p[1] - r, 2 * r, 2 * r);
  else { c.moveTo(p[0] - r, p[1]); c.lineTo(p[0] + r, p[1]); c.moveTo(p[0], p[1] - r); c.lineTo(p[0], p[1] + r); }
  if (look.face) { c.fillStyle = {ink: INK, own: colour}[look.face] || look.face; c.fill(); }
  if (look.face === "own") c.strokeStyle = INK;
  c.stroke();
}

// ---- background: grid in m, or box and axes
function nice(x) { const p = 10 ** Math.floor(Math.log10(x)); return p * [1, 2, 5, 10].find(n => n * p >= x * 0.999); }
const short = x => String(+x.toPrecision(6));
function grid(c, width, height, eyeing) {
  const step = nice(80 / eyeing.k), x0 = middle[0] - width / 2 / eyeing.k, x1 = middle[0] + width / 2 / eyeing.k;
  const y0 = middle[1] - height / 2 / eyeing.k, y1 = middle[1] + height / 2 / eyeing.k;
  c.strokeStyle = "#e8e8e8"; c.fillStyle = "#555"; c.lineWidth = 1; c.font = "12px system-ui, sans-serif"; c.setLineDash([]);
  c.textAlign = "center";
  for (let n = Math.ceil(x0 / step); n * step <= x1; n++) {
    const p = eyeing.see([n * step, 0, 0])[0];
    stroke(c, [[p, 0], [p, height]]); c.stroke();
    if (p > 40 && p < width - 52) c.fillText(short(n * step), p, height - 5);
  }
  c.fillText("x [m]", width - 24, height - 5); c.textAlign = "left";
  for (let n = Math.ceil(y0 / step); n * step <= y1; n++) {
    const p = eyeing.see([0, n * step, 0])[1];
    stroke(c, [[0, p], [width, p]]); c.stroke();
    if (p > 28 && p < height - 24) c.fillText(short(n * step), 4, p - 3);
  }
  c.fillText("y [m]", 4, 14);
}
function box(c, width, height, eyeing) {
  const half = extent.map(v => Math.max(v / 2, 0.15 * radius));
  const corner = n => eyeing.see(middle.map((v, i) => v + (n >> i & 1 ? 1 : -1) * half[i]));
  c.strokeStyle = "#dcdcdc"; c.lineWidth = 1; c.setLineDash([]);
  for (let n = 0; n < 8; n++) for (const b of [1, 2, 4]) if (!(n & b)) { stroke(c, [corner(n), corner(n | b)]); c.stroke(); }
  c.font = "13px system-ui, sans-serif"; c.fillStyle = "#333"; c.strokeStyle = "#333"; c.lineWidth = 1.5; c.textAlign = "center";
  const o = [44, height - 52];
  ["x", "y", "z"].forEach((name, i) => {
    const d = [eyeing.e.x[i], -eyeing.e.y[i]];
    stroke(c, [o, [o[0] + 26 * d[0], o[1] + 26 * d[1]]]); c.stroke();
    c.fillText(name, o[0] + 36 * d[0], o[1] + 36 * d[1] + 4);
  });
  const step = nice(50 / eyeing.k), w = step * eyeing.k;
  stroke(c, [[width - 20 - w, height - 18], [width - 20, height - 18]]); c.lineWidth = 3; c.stroke();
  c.fillText(short(step) + " m", width - 20 - w / 2, height - 26);
}
function gravity(c, width, eyeing) {
  if (!g) return;
  const d = [dot(film.gravity, eyeing.e.x) / g, -dot(film.gravity, eyeing.e.y) / g], o = [width - 26, 28];
  const tip = [o[0] + 17 * d[0], o[1] + 17 * d[1]], tail = [o[0] - 17 * d[0], o[1] - 17 * d[1]];
  const barb = s => [tip[0] - 8 * d[0] + 4 * s * d[1], tip[1] - 8 * d[1] - 4 * s * d[0]];
  c.strokeStyle = c.fillStyle = "#333"; c.lineWidth = 1.6; c.setLineDash([]);
  stroke(c, [tail, tip, barb(1), tip, barb(-1)]); c.stroke();
  c.font = "12px system-ui, sans-serif"; c.textAlign = "right";
  c.fillText("g = " + short(+g.toPrecision(4)) + " m/s\u00b2", o[0] - 14, 32);
}

function names(c, f, poses, eyeing, taken) {
  c.font = "12px system-ui, sans-serif"; c.textAlign = "left"; c.lineJoin = "round";
  const where = x => scaled(at(x.at, f), film.unit);
  for (const label of [...film.labels].sort((a, b) => b.strong - a.strong)) {
    const p = eyeing.see(label.body ? carried(poses[label.body], where(label)) : where(label));
    const w = c.measureText(label.text).width;
    const tries = [[9, -7], [9, 17], [-9 - w, -7], [-9 - w, 17], [-w / 2, -16], [-w / 2, 26]];
    const free = tries.map(o => [p[0] + o[0], p[1] + o[1] - 11, w, 15])
      .find(b => taken.every(q => b[0] > q[0] + q[2] || q[0] > b[0] + b[2] || b[1] > q[1] + q[3] || q[1] > b[1] + b[3]));
    if (!free) continue;
    taken.push(free);
    c.strokeStyle = "rgba(255,255,255,.85)"; c.lineWidth = 3; c.strokeText(label.text, free[0], free[1] + 11);
    c.fillStyle = label.strong ? INK : "#555"; c.fillText(label.text, free[0], free[1] + 11);
  }
}

function drawView(f) {
  const wide = view.clientWidth;
  const wanted = film.planar ? 68 + (wide - 68) * extent[1] / (extent[0] || 1) : wide < 500 ? 0.95 * wide : 0.72 * wide;
  const {c, width, height} = fitted(view, Math.round(Math.max(240, Math.min(wanted, 0.66 * window.innerHeight, 720))));
  const eyeing = lens(width, height);
  film.planar ? grid(c, width, height, eyeing) : box(c, width, height, eyeing);
  const poses = {};
  for (const name in film.bodies) poses[name] = pose(name, f);
  const last = (f.s < 0.5 ? f.i : f.j) * film.fine;
  if (el("trails").checked) for (const trail of film.trails)
    paint(c, "trail", trail.colour, trail.points.slice(0, last + 1).map(p => eyeing.see(scaled(p, film.unit))));
  const drawn = film.shapes.map(s => ({s, pts: pointsOf(s, poses, f).map(eyeing.see)}));
  const layer = d => film.looks[d.s.kind].layer, depth = d => d.pts.reduce((a, p) => a + p[2], 0) / d.pts.length;
  drawn.sort((a, b) => layer(a) - layer(b) || (film.planar ? 0 : depth(a) - depth(b)));
  for (const d of drawn) if (d.pts.length > 1 || film.looks[d.s.kind].marker) paint(c, d.s.kind, d.s.colour, d.pts);
  gravity(c, width, eyeing);
  if (el("names").checked) names(c, f, poses, eyeing, [[width - 130, 0, 130, 50]]);
}

// ---- sensors over time
const DASH = [[], [7, 4], [8, 3, 2, 3], [2, 3]];
function drawStrip(f) {
  if (!film.curves.length) return;
  const each = 104, {c, width} = fitted(strip, each * film.curves.length + 20), left = 62, right = width - 10;
  const X = time => left + (right - left) * (time - T0) / span, k = (f.s < 0.5 ? f.i : f.j) * film.fine;
  c.font = "12px system-ui, sans-serif";
  film.curves.forEach((curve, n) => {
    const top = each * n + 20, bottom = each * (n + 1) - 8, all = curve.values.flat();
    let lo = Math.min(...all), hi = Math.max(...all);
    if (hi - lo < 1e-9 * (Math.abs(hi) + Math.abs(lo) + 1e-30)) { lo -= 1; hi += 1; }
    const Y = v => bottom - (bottom - top) * (v - lo) / (hi - lo);
    c.setLineDash([]); c.lineWidth = 1; c.strokeStyle = "#ddd"; c.strokeRect(left, top, right - left, bottom - top);
    c.fillStyle = "#555"; c.textAlign = "right";
    c.fillText(hi.toPrecision(3), left - 5, top + 9); c.fillText(lo.toPrecision(3), left - 5, bottom);
    c.textAlign = "left"; c.fillStyle = INK;
    c.fillText(curve.label, left, top - 6);
    let pen = left + c.measureText(curve.label).width + 10;
    curve.values.forEach((values, j) => {
      const text = (curve.parts[j] ? curve.parts[j] + " " : "") + values[k].toPrecision(3);
      c.strokeStyle = film.colours[j % film.colours.length]; c.lineWidth = 1.6; c.setLineDash(DASH[j % DASH.length]);
      if (curve.parts.length > 1 && pen < right) { stroke(c, [[pen, top - 10], [pen + 15, top - 10]]); c.stroke(); pen += 18; }
      c.fillText(text, pen, top - 6); pen += c.measureText(text).width + 8;
      stroke(c, values.map((v, i) => [X(film.times[i]), Y(v)])); c.stroke();
    });
    c.setLineDash([]); c.strokeStyle = INK; c.lineWidth = 1.4; stroke(c, [[X(now), top], [X(now), bottom]]); c.stroke();
  });
  c.fillStyle = "#555"; c.textAlign = "left"; c.fillText(short(T0), left, strip.clientHeight - 6);
  c.textAlign = "right"; c.fillText("time [s]   " + short(T1), right, strip.clientHeight - 6);
}

// ---- time
function show() {
  const f = frame();
  drawView(f); drawStrip(f);
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
  if (now >= T1) { now = T1; show(); setPlaying(false); return; }
  show(); requestAnimationFrame(tick);
}
play.addEventListener("click", () => setPlaying(!playing));
slide.addEventListener("input", () => { setPlaying(false); now = T0 + span * Number(slide.value) / 1000; show(); });
for (const id of ["names", "trails"]) el(id).addEventListener("change", show);
window.addEventListener("resize", show);

// ---- turning the view of a spatial scene
function turnBy(a, b) { camera.turn += a; camera.tip = Math.max(-1.55, Math.min(1.55, camera.tip + b)); show(); }
if (!film.planar) {
  view.classList.add("space"); el("reset").hidden = false;
  el("hint").textContent = "Drag to turn the view, or use the arrow keys on it. Space plays and pauses.";
  view.addEventListener("pointerdown", e => { drag = [e.clientX, e.clientY]; view.setPointerCapture(e.pointerId); });
  view.addEventListener("pointermove", e => {
    if (!drag) return;
    turnBy(-(e.clientX - drag[0]) * 0.01, (e.clientY - drag[1]) * 0.01); drag = [e.clientX, e.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, () => { drag = null; });
  el("reset").addEventListener("click", () => { camera = {...HOME}; show(); });
} else el("hint").textContent = "Space plays and pauses while the drawing has the focus.";
view.addEventListener("keydown", e => {
  const turn = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[e.key];
  if (turn && !film.planar) { turnBy(...turn); e.preventDefault(); }
  if (e.key === " ") { setPlaying(!playing); e.preventDefault(); }
});
play.disabled = slide.disabled = t.length < 2;
film.trails.forEach(trail => {
  const name = document.createElement("span");
  name.textContent = trail.name; name.style.borderBottom = "3px solid " + trail.colour;
  el("trailbox").append(name);
});
el("trailbox").hidden = !film.trails.length; strip.hidden = !film.curves.length;
show();
</script>
</body>
</html>
"""
