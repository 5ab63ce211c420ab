"""An HTML page that plays an animation in any browser; the data are JSON in the page, so that it loads nothing."""

from __future__ import annotations

import html
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.show import WIDE, fitting
from mbdae.show.drawing import LOOKS
from mbdae.show.geometry import MARK, Geometry, Outline
from mbdae.show.plots import COLOURS
from mbdae.show.shapes import Film, digits
from mbdae.values import Array

#: JavaScript of the player that draws the motion; what it draws in space; the library three.js for this (see CONTRIBUTING.md)
VIEW, SPACE, THREE = (Path(__file__).with_name(name).read_text(encoding="utf-8")
                      for name in ("player.js", "space.js", "three.min.js"))
# -- HTML of the player; `player.page` replaces the fields between @ signs


PAGE = r"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@NAME@</title>
<link rel="icon" href="data:,">
<style>
:root { color-scheme: light dark; --ground: #fff; --ink: #222; --faint: #555; --edge: #777; --button: #f4f4f4;
        --rim: #ccc; --sky: linear-gradient(#fdfdfe, #e6eaef); }
@media (prefers-color-scheme: dark) {  /* drawings keep their hues; their brightness is turned round */
  :root { --ground: #131416; --ink: #ddd; --faint: #aaa; --edge: #888; --button: #2a2c30;
          --rim: #444; --sky: linear-gradient(#24282d, #16181b); }
  canvas { filter: invert(.92) hue-rotate(180deg); }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 12px 16px; max-width: 1500px; font: 15px/1.4 system-ui, sans-serif; color: var(--ink);
       background: var(--ground); }
h1 { font-size: 1.15rem; margin: 0 0 8px; overflow-wrap: anywhere; }
canvas { display: block; width: 100%; }
#stage { position: relative; border: 1px solid var(--rim); border-radius: 6px; overflow: hidden; }
#lit { position: absolute; inset: 0; filter: none; background: var(--sky); }
#view { position: relative; cursor: grab; touch-action: none; }
.unseen { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
#view:active { cursor: grabbing; }
#page { display: grid; grid-template-columns: minmax(0, 1fr); gap: 4px 20px; }
@media (min-width: 900px) {
  #page.charts { grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); grid-template-rows: auto 1fr; }
  #strips { grid-column: 2; grid-row: 1 / 3; } #more { grid-column: 1; grid-row: 2; }
}
figure { margin: 0 0 8px; }
figcaption { font-size: .82rem; display: flex; flex-wrap: wrap; gap: 0 12px; overflow-wrap: anywhere;
             font-variant-numeric: tabular-nums; }
figure canvas { touch-action: pan-y; cursor: ew-resize; }
.key { display: inline-block; width: 22px; height: 0; border-top: 3px solid; vertical-align: middle; margin-right: 4px; }
#bar, #more { display: flex; flex-wrap: wrap; gap: 4px 12px; align-items: center; margin: 8px 0 0; align-content: start; }
#more { margin: 0 0 8px; }
#slide { flex: 1 1 160px; min-width: 120px; }
button, select { font: inherit; padding: 6px 12px; min-height: 40px; touch-action: manipulation; border: 1px solid var(--edge);
                 border-radius: 6px; background: var(--button); color: var(--ink); }
#play { min-width: 6em; font-weight: 600; }
:is(button, select, input, canvas):focus-visible { outline: 3px solid #0072B2; outline-offset: 1px; }
label { display: inline-flex; flex-wrap: wrap; gap: 6px; align-items: center; }
[hidden] { display: none !important; }
output { font-variant-numeric: tabular-nums; min-width: 7em; }
select { max-width: 11em; }
input[type=checkbox] { width: 20px; height: 20px; margin: 8px 0; }
#slide { height: 40px; touch-action: none; }
#hint { color: var(--faint); font-size: .87rem; margin: 6px 0; }
</style>
</head>
<body>
<h1>@NAME@</h1>
<div id="page">
<div>
<div id="stage">
<canvas id="lit" aria-hidden="true" hidden></canvas>
<canvas id="view" tabindex="0" role="img" aria-label="Moving drawing of @NAME@" aria-describedby="told"></canvas>
</div>
<p id="told" class="unseen">@TOLD@</p>
<p id="flat" hidden>This browser has no WebGL: the scene is drawn by its lines, without light and shadow.</p>
<div id="bar">
<button id="play" type="button" aria-label="Play">&#9654; Play</button>
<input id="slide" type="range" min="0" max="1000" value="0" step="1" aria-label="Time">
<output id="time" for="slide"></output>
<label>Speed <select id="speed">@SPEEDS@</select></label>
</div>
</div>
<div id="strips" hidden></div>
<div id="more">
<button id="back" type="button" aria-label="One picture back">&#8722;1</button>
<button id="on" type="button" aria-label="One picture on">+1</button>
<label><input id="loop" type="checkbox"> Repeat</label>
<label><input id="names" type="checkbox" checked> Names</label>
<label id="trailbox" hidden><input id="trails" type="checkbox" checked> Trails:</label>
<label id="followbox" hidden>Follow <select id="follow"><option value="">nothing</option></select></label>
<button id="reset" type="button">Reset view</button>
</div>
</div>
<p id="hint"></p>
<script id="film" type="application/json">@DATA@</script>
@THREE@<script>
"use strict";
@SCRIPT@</script>
</body>
</html>
"""


# -- JavaScript of the player for charts, time and user input; in the page it follows the script of the view


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


GRAIN = 1e-4  #: resolution of stored coordinates over the scene's size, and of the entries of rotation matrices
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def page(film: Film) -> str:
    """The page as HTML text."""
    data = json.dumps(film_data(film), separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    name = html.escape(film.seen.name)
    options = "".join(f'<option value="{s:g}"{" selected" if s == film.speed else ""}>&times; {s:g}</option>'
                      for s in sorted({*SPEEDS, film.speed}))
    space = "" if film.seen.planar else SPACE
    fields = {"@SCRIPT@": space + VIEW + CONTROLS, "@THREE@": "" if film.seen.planar else f"<script>\n{THREE}</script>\n",
              "@TOLD@": html.escape(told(film)), "@NAME@": name, "@SPEEDS@": options, "@DATA@": data}
    text = PAGE
    for field, value in fields.items():
        text = text.replace(field, value)
    return text


def told(film: Film) -> str:
    """What the moving drawing shows, for those who do not see it."""
    seen, span = film.seen, film.seen.t
    names = {strong: ", ".join(label.text for label in seen.labels if label.of_body is strong) for strong in (True, False)}
    parts = [f"bodies: {names[True]}"] * bool(names[True]) + [f"joints and forces: {names[False]}"] * bool(names[False])
    return f"A mechanism in {'the plane' if seen.planar else 'space'} from {span[0]:g} s to {span[-1]:g} s; {'; '.join(parts)}."


def film_data(film: Film) -> dict[str, Any]:
    """Data of an animation for JSON: coordinates as whole multiples of `unit` m, rotations as multiples of `GRAIN`."""
    seen = film.seen
    unit, low_high = seen.size * GRAIN, np.array(seen.bounds)
    if film.trails:
        reached = np.vstack([trail.points for trail in film.trails])
        low_high = np.array([np.minimum(low_high[0], reached.min(axis=0)), np.maximum(low_high[1], reached.max(axis=0))])
    return {
        "name": seen.name, "planar": seen.planar, "unit": unit, "grain": GRAIN, "mark": MARK * seen.size, "speed": film.speed,
        "t": _short(seen.t), "times": _short(film.times), "fine": film.fine, "digits": digits(seen.t),
        "gravity": seen.gravity.tolist(), "newtons": seen.newtons,
        "low": _short(low_high[0]), "high": _short(low_high[1]), "looks": {k: asdict(v) for k, v in LOOKS.items()},
        "colours": COLOURS, "bodies": {name: _pose(seen, name, unit) for name in seen.poses},
        "shapes": [_shape(shape, unit) for shape in seen.shapes],
        "labels": [{"lines": fitting(x.text, WIDE).split("\n"), "body": x.body, "at": _whole(x.points, unit), "strong": x.of_body}
                   for x in seen.labels],
        "trails": [{"name": x.name, "colour": x.colour, "points": _whole(x.points, unit)} for x in film.trails],
        "curves": [{"label": x.label, "parts": x.components, "values": _short(x.values.T)} for x in film.curves],
    }


def _whole(points: Array, unit: float) -> Any:
    return np.round(points / unit).astype(int).tolist()


def _short(values: Array) -> Any:
    """Values rounded to seven significant digits, as lists."""
    return np.reshape([float(f"{v:.7g}") for v in np.asarray(values).ravel()], np.shape(values)).tolist()


def _pose(seen: Geometry, name: str, unit: float) -> dict[str, Any]:
    """Position (nt, 3) and entries of the rotation matrix (nt, 9), or (1, 9) where it never changes."""
    pose = seen.poses[name]
    turn = pose.rotation.reshape(-1, 9)
    still = bool(np.all(np.abs(turn - turn[0]) < GRAIN / 2))
    return {"r": _whole(pose.position, unit), "R": _whole(turn[:1] if still else turn, GRAIN)}


def _shape(shape: Outline, unit: float) -> dict[str, Any]:
    solid = {"faces": shape.faces, "shades": shape.shades} if shape.faces else {}
    return {"kind": shape.kind, "colour": shape.colour, "body": shape.body, "points": _whole(shape.points, unit), **solid}
