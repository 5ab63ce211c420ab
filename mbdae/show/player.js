const film = JSON.parse(document.getElementById("film").textContent);
const el = id => document.getElementById(id);
const view = el("view"), play = el("play"), slide = el("slide");
const t = film.t, T0 = t[0], T1 = t[t.length - 1], span = T1 - T0 || 1;
const INK = "#222222", HOME = {turn: -0.96, tip: 0.38, zoom: 1, x: 0, y: 0};
let now = T0, playing = false, before = 0, camera = {...HOME};

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
const near = (list, f) => list[f.s < 0.5 ? f.i : f.j];
const at = (list, f) => list.length === 1 ? list[0] : f.s ? between(list[f.i], list[f.j], f.s) : list[f.i];
const between = (a, b, s) => Array.isArray(a) ? a.map((x, i) => between(x, b[i], s)) : a + s * (b - a);
function turned(list, f) {  // interpolated axes; those of the nearer frame where the rotation between two frames is large
  if (list.length === 1 || !f.s) return list[list.length === 1 ? 0 : f.i];
  const a = list[f.i], b = list[f.j];
  if (dot(a, b) + dot(a.slice(3), b.slice(3)) + dot(a.slice(6), b.slice(6)) < 1.5 / film.grain ** 2) return near(list, f);
  const R = between(a, b, f.s), x = unit([R[0], R[3], R[6]]), z = unit(cross(x, [R[1], R[4], R[7]])), y = cross(z, x);
  return [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]].map(v => v / film.grain);
}
function pose(name, f) {
  const b = film.bodies[name];
  return {r: scaled(at(b.r, f), film.unit), R: scaled(turned(b.R, f), film.grain)};
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
const side = unit(Math.abs(up[2]) > 0.9 ? [1, 0, 0] : cross(up, [0, 0, 1])), fore = cross(up, side);  // level directions
function eye() {
  if (film.planar) return {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]};
  const flat = side.map((v, i) => Math.cos(camera.turn) * v + Math.sin(camera.turn) * fore[i]);
  const z = flat.map((v, i) => Math.cos(camera.tip) * v + Math.sin(camera.tip) * up[i]);
  const x = unit(cross(up, z));
  return {x, y: cross(z, x), z};
}
const middle = film.low.map((v, i) => (v + film.high[i]) / 2), extent = film.high.map((v, i) => v - film.low[i]);
const radius = Math.hypot(...extent) / 2 || 1;
// width and height of the view at home, however it is turned about the vertical: those of the upright cylinder around everything
const tall = dot(extent, up.map(Math.abs)), wide = Math.sqrt(Math.max(dot(extent, extent) - tall ** 2, 0.01 * radius ** 2));
const room = [wide, tall * Math.cos(HOME.tip) + wide * Math.sin(HOME.tip)];

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

function lens(width, height, center) {
  const e = eye(), pad = film.planar ? 34 : 20;
  const [w, h] = film.planar ? extent : room;
  const k = camera.zoom * Math.min((width - 2 * pad) / (w || 1e-9), (height - 2 * pad) / (h || 1e-9));
  const o = [width / 2 + camera.x, height / 2 + camera.y];
  const see = p => {
    const d = p.map((v, i) => v - center[i]);
    return [o[0] + k * dot(d, e.x), o[1] - k * dot(d, e.y), dot(d, e.z)];
  };
  return {see, k, e, o, center};
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
  const {k, o, center} = eyeing, step = nice(80 / k), x0 = center[0] - o[0] / k, x1 = center[0] + (width - o[0]) / k;
  const y0 = center[1] - (height - o[1]) / k, y1 = center[1] + o[1] / k;
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
function scale(c, width, height, eyeing) {
  c.font = "13px system-ui, sans-serif"; c.fillStyle = "#333"; c.strokeStyle = "#333"; c.lineWidth = 1.5; c.textAlign = "center";
  const o = [44, height - 52];
  c.lineCap = "round";
  ["x", "y", "z"].forEach((name, i) => {
    const d = [eyeing.e.x[i], -eyeing.e.y[i]];
    stroke(c, [o, [o[0] + 26 * d[0], o[1] + 26 * d[1]]]); c.stroke();
    c.fillText(name, o[0] + 36 * d[0], o[1] + 36 * d[1] + 4);
  });
  const step = nice(50 / eyeing.k), w = step * eyeing.k;
  stroke(c, [[width - 20 - w, height - 18], [width - 20, height - 18]]); c.lineWidth = 3; c.stroke();
  c.fillText(short(step) + " m", width - 20 - w / 2, height - 26);
  if (!film.newtons) return;
  const force = nice(40 * film.newtons / eyeing.k), reach = 20 + force / film.newtons * eyeing.k;
  stroke(c, [[20, 22], [reach, 22], [reach - 8, 18], [reach, 22], [reach - 8, 26]]); c.lineWidth = 2; c.stroke();
  c.textAlign = "left"; c.fillText(short(force) + " N", reach + 8, 26);
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

const AROUND = [0.785, 2.356, -0.785, -2.356, 1.571, 0, 3.142, -1.571].map(a => [Math.cos(a), -Math.sin(a)]);
const PLACES = [9, 18, 32].flatMap(reach => AROUND.map(way => ({way, reach}))), chosen = new Map();
function names(c, f, poses, eyeing, taken, width, height) {
  c.font = "12px system-ui, sans-serif"; c.textAlign = "left"; c.lineJoin = "round"; c.setLineDash([]);
  for (const label of [...film.labels].sort((a, b) => b.strong - a.strong)) {
    const point = scaled(at(label.at, f), film.unit), p = eyeing.see(label.body ? carried(poses[label.body], point) : point);
    if (p[0] < 0 || p[0] > width || p[1] < 0 || p[1] > height) continue;
    const w = Math.max(...label.lines.map(line => c.measureText(line).width)), h = 14 * label.lines.length;
    const put = ({way, reach}) => [
      Math.max(3, Math.min(width - w - 3, p[0] + way[0] * reach + (way[0] - 1) * w / 2)),
      Math.max(3, Math.min(height - h - 3, p[1] + way[1] * reach + (way[1] - 1) * h / 2)), w, h];
    const free = b => taken.every(q => b[0] > q[0] + q[2] + 2 || q[0] > b[0] + b[2] + 2 || b[1] > q[1] + q[3]
                                       || q[1] > b[1] + b[3]);
    const first = chosen.get(label), found = [...(first ? [first] : []), ...PLACES].find(place => free(put(place)));
    if (!found) continue;
    chosen.set(label, found);
    const b = put(found);
    taken.push(b);
    c.strokeStyle = "rgba(255,255,255,.85)"; c.lineWidth = 3; c.fillStyle = label.strong ? INK : "#555";
    label.lines.forEach((line, i) => { for (const ink of ["strokeText", "fillText"]) c[ink](line, b[0], b[1] + 11 + 14 * i); });
  }
}

// three.js draws what is in space (space.js); without it, as in the plane, lines are drawn here, all edges of solids among them
const space = film.planar ? null : spaceOn(el("lit"));
el("lit").hidden = !space; el("flat").hidden = film.planar || space;
function drawLines(c, f, poses, see) {
  if (el("trails").checked) for (const trail of film.trails)
    paint(c, "trail", trail.colour, trail.points.slice(0, (f.s < 0.5 ? f.i : f.j) * film.fine + 1).map(p => see(scaled(p, film.unit))));
  for (const s of [...film.shapes].sort((a, b) => film.looks[a.kind].layer - film.looks[b.kind].layer)) {
    const pts = pointsOf(s, poses, f).map(see);
    if (s.faces) for (const face of s.faces) paint(c, "line", s.colour, [...face, face[0]].map(n => pts[n]));
    else if (pts.length > 1 || film.looks[s.kind].marker) paint(c, s.kind, s.colour, pts);
  }
}
function drawView(f) {
  const across = view.clientWidth, tall = film.planar ? 68 + (across - 68) * extent[1] / (extent[0] || 1) : 0;
  const wanted = tall || (across < 500 ? 0.95 : 0.72) * across;
  const {c, width, height} = fitted(view, Math.round(Math.max(240, Math.min(wanted, 0.62 * (top === window ? innerHeight : 660), 720))));
  const poses = {};
  for (const name in film.bodies) poses[name] = pose(name, f);
  const followed = poses[el("follow").value], eyeing = lens(width, height, followed ? followed.r : middle);
  (film.planar ? grid : scale)(c, width, height, eyeing);
  if (space) space.draw(poses, f, eyeing, width, height);
  else drawLines(c, f, poses, eyeing.see);
  gravity(c, width, eyeing);
  if (el("names").checked) names(c, f, poses, eyeing, [[width - 130, 0, 130, 50]], width, height);
}
