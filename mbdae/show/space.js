// ---- scenes in space, by three.js: bodies as solids with light and shadow. The canvas of names and scales lies over this one.
const DARK = window.matchMedia("(prefers-color-scheme: dark)");
const SHARP = 0.45, CREASE = 0.8, CAP = [0, 0.5, 0.87];  // cosines of corners that part a rod, or a surface; rounding of an end

function tinted(colour, shade) {  // what is drawn in ink is light where the page is dark
  const c = new THREE.Color(colour === INK && DARK.matches ? "#cfd3d8" : colour);
  return shade ? c.multiplyScalar(0.62) : c;
}
function solidOf(corners, faces, shades, colour) {  // [positions, normals, colours] of triangles; smooth but at creases
  const normals = faces.map(face => {
    const q = face.map(n => corners[n]), m = q[q.length - 1];
    return unit(cross(q[2].map((v, i) => v - q[0][i]), m.map((v, i) => v - q[1][i])));
  });
  const around = corners.map(() => []);
  faces.forEach((face, n) => face.forEach(corner => around[corner].push(normals[n])));
  const out = [[], [], []];
  faces.forEach((face, n) => {
    const tone = tinted(colour, shades[n]);
    for (let i = 2; i < face.length; i++) for (const corner of [face[0], face[i - 1], face[i]]) {
      const near = around[corner].filter(other => dot(other, normals[n]) > CREASE);
      out[0].push(...corners[corner]);
      out[1].push(...unit([0, 1, 2].map(k => near.reduce((s, v) => s + v[k], 0))));
      out[2].push(tone.r, tone.g, tone.b);
    }
  });
  return out;
}
function rodsOf(points, radius, sides) {  // [positions, normals, indices] of a polyline as a rod with round ends
  const out = [[], [], []], minus = (a, b) => a.map((v, i) => v - b[i]);
  const path = points.filter((p, i) => !i || Math.hypot(...minus(p, points[i - 1])) > 1e-3 * radius);
  const ways = path.slice(1).map((p, i) => unit(minus(p, path[i])));
  for (let from = 0; from < ways.length;) {
    let to = from + 1;
    while (to < ways.length && dot(ways[to - 1], ways[to]) > SHARP) to++;
    piece(path.slice(from, to + 1), ways.slice(from, to));
    from = to;
  }
  function piece(line, way) {
    let e = unit(cross(way[0], Math.abs(way[0][2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
    const rings = [], add = (p, t, far, wide) => {
      e = unit(minus(e, scaled(t, dot(e, t))));
      rings.push({p: p.map((v, i) => v + far * radius * t[i]), t, e, f: cross(t, e), lean: far, wide});
    };
    for (const s of CAP.toReversed()) add(line[0], way[0], -s, Math.sqrt(1 - s * s));
    for (let i = 1; i < line.length - 1; i++) {
      const t = unit(way[i - 1].map((v, k) => v + way[i][k]));
      add(line[i], t, 0, 1 / Math.max(0.6, dot(t, way[i])));
    }
    for (const s of CAP) add(line[line.length - 1], way[way.length - 1], s, Math.sqrt(1 - s * s));
    for (const ring of rings) for (let j = 0; j < sides; j++) {
      const a = 2 * Math.PI * j / sides, n = [0, 1, 2].map(i => Math.cos(a) * ring.e[i] + Math.sin(a) * ring.f[i]);
      out[0].push(...ring.p.map((v, i) => v + radius * ring.wide * n[i]));
      out[1].push(...unit(n.map((v, i) => v * ring.wide + ring.t[i] * ring.lean)));
    }
    const first = out[0].length / 3 - rings.length * sides;
    for (let r = 0; r < rings.length - 1; r++) for (let j = 0; j < sides; j++) {
      const a = first + r * sides + j, b = first + r * sides + (j + 1) % sides;
      out[2].push(a, b, b + sides, a, b + sides, a + sides);
    }
  }
  return out;
}
function shaped([positions, normals, third], coloured) {
  const made = new THREE.BufferGeometry();
  made.setAttribute("position", new THREE.BufferAttribute(new Float32Array(positions), 3));
  made.setAttribute("normal", new THREE.BufferAttribute(new Float32Array(normals), 3));
  if (coloured) made.setAttribute("color", new THREE.BufferAttribute(new Float32Array(third), 3));
  else made.setIndex(third);
  return made;
}
function rectangle(points) {  // corners of the rectangle that a grid fills
  const from = points[0], minus = p => p.map((v, i) => v - from[i]), u = unit(minus(points[1]));
  const far = points.map(minus).map(d => d.map((v, i) => v - dot(d, u) * u[i]));
  const v = unit(far.reduce((a, b) => Math.hypot(...b) > Math.hypot(...a) ? b : a));
  const reach = e => { const s = points.map(p => dot(minus(p), e)); return [Math.min(...s), Math.max(...s)]; };
  const [a, b] = reach(u), [c, d] = reach(v);
  return [[a, c], [b, c], [b, d], [a, d]].map(([x, y]) => from.map((o, i) => o + x * u[i] + y * v[i]));
}

function spaceOn(canvas) {
  const context = canvas.getContext("webgl2", {antialias: true, alpha: true});
  if (!context) return null;
  const mark = film.mark, world = new THREE.Scene(), camera = new THREE.OrthographicCamera(), groups = {}, moving = [];
  const renderer = new THREE.WebGLRenderer({canvas, context, antialias: true, alpha: true});
  renderer.shadowMap.enabled = true;
  camera.matrixAutoUpdate = false;
  const sky = new THREE.HemisphereLight(0xffffff, 0x9a9a92, 1.7), sun = new THREE.DirectionalLight(0xffffff, 2.3);
  sky.position.set(...up);
  sun.position.set(...middle.map((v, i) => v + 4 * radius * unit(up.map((u, n) => 1.5 * u + 0.55 * side[n] - 0.75 * fore[n]))[i]));
  sun.target.position.set(...middle);
  sun.castShadow = true; sun.shadow.mapSize.set(2048, 2048); sun.shadow.radius = 3; sun.shadow.normalBias = 0.1 * mark;
  Object.assign(sun.shadow.camera, {left: -1.5 * radius, right: 1.5 * radius, top: 1.5 * radius, bottom: -1.5 * radius,
                                    near: radius, far: 8 * radius});
  const floor = new THREE.Mesh(new THREE.PlaneGeometry(12 * radius, 12 * radius), new THREE.ShadowMaterial({opacity: 0.22}));
  floor.receiveShadow = true; floor.matrixAutoUpdate = false;
  const lowest = Math.min(...[0, 1, 2, 3, 4, 5, 6, 7].map(n => dot(up, film.low.map((v, i) => n >> i & 1 ? film.high[i] : v))));
  const below = middle.map((v, i) => v + (lowest - 0.6 * mark - dot(up, middle)) * up[i]);
  floor.matrix.makeBasis(...[side, fore, up].map(a => new THREE.Vector3(...a))).setPosition(...below);

  const lit = (colour, more) => new THREE.MeshStandardMaterial({color: tinted(colour), roughness: 0.55, ...more});
  function holder(shape) {
    if (!shape.body) return world;
    if (!groups[shape.body]) {
      groups[shape.body] = new THREE.Group(); groups[shape.body].matrixAutoUpdate = false; world.add(groups[shape.body]);
    }
    return groups[shape.body];
  }
  function put(shape, geometry, material, shadow = true) {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.castShadow = shadow; mesh.receiveShadow = true; mesh.frustumCulled = false;
    holder(shape).add(mesh);
    return mesh;
  }
  const local = (shape, f) => at(shape.points, f).map(p => scaled(p, film.unit));
  function rod(shape, first) {
    const radius = film.looks[shape.kind].rod * mark, sides = shape.kind === "bar" ? 14 : 8, loud = shape.kind === "arrow" || shape.kind === "push";
    const make = f => shaped(rodsOf(local(shape, f), radius, sides), false);
    const meshes = [put(shape, make(first), lit(shape.colour))];
    if (loud) {  // drives and forces are seen through what is in front of them
      meshes.push(put(shape, meshes[0].geometry, lit(shape.colour, {depthTest: false, transparent: true, opacity: shape.kind === "push" ? 0.85 : 0.45}), false));
      meshes[1].renderOrder = 2;
    }
    if (shape.kind === "push") {  // the point of contact, where a force acts
      const ball = put(shape, new THREE.SphereGeometry(2 * radius, 16, 12), meshes[1].material, false);
      const go = f => { const q = local(shape, f); ball.position.set(...q[0]); ball.visible = q[0].some((v, i) => v !== q[1][i]); };
      ball.renderOrder = 2; go(first);
      if (shape.points.length > 1) moving.push(go);
    }
    if (shape.points.length > 1) moving.push(f => {
      const fresh = make(f); meshes[0].geometry.dispose(); for (const mesh of meshes) mesh.geometry = fresh;
    });
    if (film.looks[shape.kind].fill && shape.points.length === 1 && shape.kind === "disc") {
      const q = local(shape, first), faces = [q.slice(1).map((_, i) => i)];
      put(shape, shaped(solidOf(q, faces, [0], shape.colour), true),
          new THREE.MeshStandardMaterial({vertexColors: true, side: THREE.DoubleSide, roughness: 0.5}));
    }
  }
  function solid(shape, first) {
    const make = f => shaped(solidOf(local(shape, f), shape.faces, shape.shades, shape.colour), true);
    const mesh = put(shape, make(first), new THREE.MeshStandardMaterial({vertexColors: true, roughness: 0.5, side: THREE.DoubleSide}));
    if (shape.points.length > 1) moving.push(f => { mesh.geometry.dispose(); mesh.geometry = make(f); });
  }
  function marker(shape, first) {
    const look = film.looks[shape.kind], colour = {ink: INK, own: shape.colour, white: "#f4f4f4"}[look.face] || shape.colour;
    const size = film.looks[shape.kind].rod * mark, square = look.marker === "s";
    const form = square ? new THREE.BoxGeometry(2 * size, 2 * size, 2 * size) : new THREE.SphereGeometry(size, 24, 16);
    const mesh = put(shape, form, lit(colour)), go = f => mesh.position.set(...local(shape, f)[0]);
    go(first);
    if (shape.points.length > 1) moving.push(go);
  }
  function grid(shape, first) {
    const points = local(shape, first), flat = new THREE.BufferGeometry();
    flat.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points.flat()), 3));
    holder(shape).add(new THREE.Line(flat, new THREE.LineBasicMaterial({color: DARK.matches ? 0x565b62 : 0xb9bec5})));
    const plate = put(shape, shaped(solidOf(rectangle(points), [[0, 1, 2, 3]], [0], DARK.matches ? "#33373d" : "#eceff2"), true),
                      new THREE.MeshLambertMaterial({vertexColors: true, side: THREE.DoubleSide, transparent: true, opacity: 0.85,
                                                     polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1}), false);
    plate.renderOrder = -1;
  }
  let trails = [];
  function build() {
    world.clear(); moving.length = 0; for (const name in groups) delete groups[name];
    const first = {i: 0, j: 0, s: 0};
    world.add(sky, sun, sun.target);
    if (!film.shapes.some(shape => shape.kind === "grid")) world.add(floor);
    floor.material.opacity = DARK.matches ? 0.5 : 0.22;
    for (const shape of film.shapes) {
      if (shape.kind === "grid") grid(shape, first);
      else if (shape.faces) solid(shape, first);
      else if (film.looks[shape.kind].marker) marker(shape, first);
      else rod(shape, first);
    }
    trails = film.trails.map(trail => {
      const points = trail.points.map(p => scaled(p, film.unit)), line = new THREE.BufferGeometry();
      line.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points.flat()), 3));
      const mesh = new THREE.Line(line, new THREE.LineBasicMaterial({color: tinted(trail.colour)}));
      mesh.frustumCulled = false; world.add(mesh);
      return mesh;
    });
  }
  build();
  DARK.addEventListener("change", () => { build(); show(); });
  return {draw(poses, f, eyeing, width, height) {
    for (const name in groups) {
      const {r, R} = poses[name];
      groups[name].matrix.set(R[0], R[1], R[2], r[0], R[3], R[4], R[5], r[1], R[6], R[7], R[8], r[2], 0, 0, 0, 1);
    }
    for (const go of moving) go(f);
    for (const mesh of trails) {
      mesh.visible = el("trails").checked;
      mesh.geometry.setDrawRange(0, (f.s < 0.5 ? f.i : f.j) * film.fine + 1);
    }
    const {k, e, o, center} = eyeing, far = 12 * radius;
    Object.assign(camera, {left: -o[0] / k, right: (width - o[0]) / k, top: o[1] / k, bottom: (o[1] - height) / k, near: 0, far: 2 * far});
    camera.matrix.makeBasis(...[e.x, e.y, e.z].map(a => new THREE.Vector3(...a)));
    camera.matrix.setPosition(...center.map((v, i) => v + far * e.z[i]));
    camera.matrixWorldNeedsUpdate = true; camera.updateProjectionMatrix();
    renderer.setPixelRatio(window.devicePixelRatio || 1); renderer.setSize(width, height, false);
    canvas.style.height = height + "px";
    renderer.render(world, camera);
  }};
}
