// The picture: organ, fingertip and force arrow in WebGL 2, and ray casting from a point of the screen to the organ.

const VERTEX = `#version 300 es
in vec3 place; in vec3 normal; in float value;
uniform mat4 camera; out vec3 n; out float v;
void main() { n = normal; v = value; gl_Position = camera * vec4(place, 1.0); }`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 n; in float v; uniform vec3 base; uniform vec3 eye; uniform vec3 lamp; uniform vec3 stretch; uniform float full;
uniform sampler2D scale; uniform float alpha;
out vec4 colour;
void main() {
  vec3 m = normalize(n / stretch); if (dot(m, eye) < 0.0) m = -m;
  vec3 rgb = full > 0.0 ? texture(scale, vec2(clamp(v / full, 0.0, 1.0), 0.5)).rgb : base;
  float light = 0.42 + 0.62 * max(dot(m, lamp), 0.0);
  float gloss = 0.22 * alpha * alpha * pow(max(dot(m, normalize(lamp + eye)), 0.0), 40.0);
  colour = vec4(rgb * light + gloss, mix(alpha, 1.0, pow(1.0 - dot(m, eye), 2.0))); // transparent parts have an opaque outline
}`;
const COLOURS = ["#e8b9a6", "#f2a07c", "#ec7f5b", "#d2434f", "#9c1c5b", "#5b1360", "#240b40"];

const RADIUS = 0.006, PATCH = 0.004; // [m] radius of the ball; radius of the patch around a foot point, see `dragged`
const SMALL = 0.12; // [m] size of the bodies below which the force arrow is shorter and thinner in proportion, as it may point to the viewer
const BALL = [0.16, 0.36, 0.55], ARROW = [0.12, 0.42, 0.66];

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); };
const along = (a, b, t) => a.map((x, i) => x + t * b[i]);

// Set the text of an element: the browser lays the page out again only if it differs.
export function write(element, text) { if (element.textContent !== text) element.textContent = text; }

// The scale of colours across a canvas.
export function ramp(canvas) {
  const paint = canvas.getContext("2d"), gradient = paint.createLinearGradient(0, 0, canvas.width, 0);
  COLOURS.forEach((c, i) => gradient.addColorStop(i / (COLOURS.length - 1), c));
  paint.fillStyle = gradient; paint.fillRect(0, 0, canvas.width, canvas.height);
}

// The data of each finger; those of the first are in the head of the frame itself.
export const each = (head) => [head, ...(head.others ?? [])];

// The fingers to draw: those with a known position.
export const fingers = (newest) => (newest ? each(newest.head).filter(({ tip }) => tip) : []);

// Numbers of all fingers as texts: force on the hand, normal force, indentation, contact and energy.
export function figures(head) {
  const joined = (of) => each(head).map(of).join(" · ");
  return {
    force: joined(({ force }) => (force ? Math.hypot(...force).toFixed(2) : "–")),
    load: joined(({ load }) => (load ?? 0).toFixed(2)),
    depth: joined(({ depth }) => (1e3 * (depth ?? 0)).toFixed(1)),
    stick: joined(({ load, stick }) => (load > 0 ? (stick === undefined ? "touches" : stick ? "sticks" : "slips") : "apart")),
    energy: joined(({ energy }) => (energy === undefined ? "–" : (1e3 * energy).toFixed(1))),
  };
}

// The same as lines of text, for a screenshot.
export function lines(head, about) {
  const { force, load, depth } = figures(head);
  return [`${about.name ?? ""} ${about.body.split(".").pop()}, ${head.time.toFixed(3)} s`.trim(), `force on the hand ${force} N, normal force ${load} N, indentation ${depth} mm`];
}

export class Scene {
  constructor(canvas) {
    this.canvas = canvas; this.labels = [canvas.parentElement.querySelector(".label")];
    this.gl = canvas.getContext("webgl2", { antialias: !software(), alpha: true });
    if (!this.gl) throw new Error("this browser has no WebGL 2, which the picture needs");
    this.azimuth = -1.15; this.height = 0.5; this.distance = 0.26; this.full = 0.01;
    this.sharp = 1; // resolution as a fraction of the screen's, along an edge
    const gl = this.gl, program = this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(program, shader);
    }
    ["place", "normal", "value"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    this.at = (name) => gl.getUniformLocation(program, name);
    gl.useProgram(program); gl.enable(gl.DEPTH_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA); // opaque pixels stay opaque
    this.organ = this.part(); this.ball = this.part(); this.arrow = this.part();
    this.shape(this.ball, ...sphere(28)); this.shape(this.arrow, ...pointer(20));
    this.ball.closed = this.arrow.closed = true;
    const strip = document.createElement("canvas"); strip.width = 256; strip.height = 1;
    ramp(strip);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, strip);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  }

  part() {
    const gl = this.gl, made = { array: gl.createVertexArray(), count: 0 };
    gl.bindVertexArray(made.array);
    ["place", "normal", "value"].forEach((name, i) => {
      made[name] = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, made[name]);
      gl.enableVertexAttribArray(i); gl.vertexAttribPointer(i, i < 2 ? 3 : 1, gl.FLOAT, false, 0, 0);
    });
    made.index = gl.createBuffer(); gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, made.index);
    return made;
  }

  fill(part, name, data) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, part[name]);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.DYNAMIC_DRAW);
  }

  shape(part, places, normals, triangles) {
    const gl = this.gl;
    this.fill(part, "place", places); this.fill(part, "normal", normals);
    this.fill(part, "value", new Float32Array(places.length / 3));
    gl.bindVertexArray(part.array); gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    part.count = triangles.length;
  }

  mesh(places, normals, triangles) {
    this.rest = places; this.restNormals = normals; this.triangles = triangles;
    this.places = places.slice(); this.normals = normals.slice(); this.values = new Float32Array(places.length / 3);
    this.moved = new Uint32Array(0);
    this.still = places; this.stillNormals = normals; this.carried = ""; this.turns = [];
    this.weights = null;
    const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    places.forEach((x, i) => { low[i % 3] = Math.min(low[i % 3], x); high[i % 3] = Math.max(high[i % 3], x); });
    this.centre = low.map((x, i) => (x + high[i]) / 2);
    this.size = Math.hypot(...sub(high, low)); this.distance = 1.75 * this.size;
    this.organ.closed = closed(triangles);
    this.shape(this.organ, this.places, this.normals, triangles);
  }

  // Move bodies: [first vertex, end, displacement, rotation matrix row by row if it rotates] of each. `still` are the vertices
  // without deformation.
  carry(bodies) {
    if (this.carried === (this.carried = JSON.stringify(bodies))) return;
    this.still = this.rest.slice(); this.stillNormals = this.restNormals.slice(); this.turns = bodies.filter((body) => body[3]);
    for (const [first, end, , turn] of this.turns) {
      for (const vectors of [this.still, this.stillNormals]) for (let k = 3 * first; k < 3 * end; k += 3) rotate(vectors, k, turn);
    }
    for (const [first, end, way] of bodies) for (let k = 3 * first; k < 3 * end; k++) this.still[k] += way[k % 3];
    this.places.set(this.still); this.normals.set(this.stillNormals);
  }

  // Displace some vertices; all others are at rest. Normals are recomputed at the displaced vertices.
  deform(nodes, displacement, values) {
    for (const i of this.moved) {
      for (let c = 3 * i; c < 3 * i + 3; c++) { this.places[c] = this.still[c]; this.normals[c] = this.stillNormals[c]; }
    }
    this.values.fill(0);
    if (this.turns.length) displacement = this.turned(nodes, displacement);
    nodes.forEach((i, k) => {
      for (let c = 0; c < 3; c++) this.places[3 * i + c] = this.still[3 * i + c] + displacement[3 * k + c];
      this.values[i] = values[k];
    });
    this.moved = nodes;
    if (nodes.length) this.smooth(new Set(nodes));
    this.fill(this.organ, "place", this.places); this.fill(this.organ, "normal", this.normals);
    this.fill(this.organ, "value", this.values);
  }

  // Displacements of vertices of bodies that rotate, in the world.
  turned(nodes, displacement) {
    const moved = displacement.slice();
    nodes.forEach((i, k) => {
      const turn = this.turns.find(([first, end]) => first <= i && i < end)?.[3];
      if (turn) rotate(moved, 3 * k, turn);
    });
    return moved;
  }

  // Colour vertices other than the displaced ones: those that carry load.
  colour(nodes, values) {
    this.values.fill(0);
    nodes.forEach((i, k) => { this.values[i] = values[k]; });
    this.fill(this.organ, "value", this.values);
  }

  // Colour by the strain of the surface, as in physics/geometry/strain.py: the largest principal strain of each triangle, and at
  // each vertex the mean of its triangles, weighted by their area at rest. Triangles at rest have no strain.
  strain() {
    const t = this.triangles, r = this.rest, p = this.places, moved = new Uint8Array(r.length / 3), { values } = this;
    const edge = (x, i, j) => [x[3 * j] - x[3 * i], x[3 * j + 1] - x[3 * i + 1], x[3 * j + 2] - x[3 * i + 2]];
    if (!this.weights) {
      this.weights = new Float32Array(values.length);
      for (let k = 0; k < t.length; k += 3) {
        const area = Math.hypot(...cross(edge(r, t[k], t[k + 1]), edge(r, t[k], t[k + 2])));
        for (let c = k; c < k + 3; c++) this.weights[t[c]] += area;
      }
    }
    for (const i of this.moved) moved[i] = 1;
    values.fill(0);
    for (let k = 0; k < t.length; k += 3) {
      const [i, j, l] = [t[k], t[k + 1], t[k + 2]];
      if (!(moved[i] || moved[j] || moved[l])) continue;
      const first = edge(r, i, j), second = edge(r, i, l), length = Math.hypot(...first), area = Math.hypot(...cross(first, second));
      if (!(area > 1e-7 * length * length)) continue;
      const x = edge(p, i, j).map((v) => v / length), slope = dot(first, second) / length, height = area / length;
      const y = edge(p, i, l).map((v, c) => (v - slope * x[c]) / height); // the columns of the gradient
      const a = dot(x, x), b = dot(x, y), c = dot(y, y), stretch = Math.sqrt((a + c) / 2 + Math.hypot((a - c) / 2, b));
      for (const v of [i, j, l]) values[v] += area * (stretch - 1);
    }
    for (let v = 0; v < values.length; v++) if (values[v]) values[v] /= this.weights[v];
    this.fill(this.organ, "value", values);
    return values;
  }

  smooth(inside) {
    const sum = new Map(), t = this.triangles, p = this.places;
    for (let k = 0; k < t.length; k += 3) {
      if (!(inside.has(t[k]) || inside.has(t[k + 1]) || inside.has(t[k + 2]))) continue;
      const [a, b, c] = [t[k], t[k + 1], t[k + 2]].map((i) => [p[3 * i], p[3 * i + 1], p[3 * i + 2]]);
      const face = cross(sub(b, a), sub(c, a));
      for (const i of [t[k], t[k + 1], t[k + 2]]) if (inside.has(i)) sum.set(i, along(face, sum.get(i) ?? [0, 0, 0], 1));
    }
    for (const [i, n] of sum) this.normals.set(unit(n), 3 * i);
  }

  view() {
    const c = Math.cos(this.height), eye = [c * Math.cos(this.azimuth), c * Math.sin(this.azimuth), Math.sin(this.height)];
    const right = unit(cross([0, 0, 1], eye)), up = cross(eye, right);
    const aspect = this.canvas.width / this.canvas.height, away = this.distance / Math.min(1.3, aspect); // so that the organ's whole width is visible
    const lamp = unit(along(along(eye, right, -0.35), up, 0.6)); // from the upper left of the viewer
    return { eye, right, up, lamp, aspect, away, from: along(this.centre, eye, away), tan: Math.tan(0.3) };
  }

  camera() {
    const { eye, right, up, from, tan, aspect, away } = this.view();
    const near = 0.02 * away, far = 6 * away, a = (far + near) / (near - far), b = (2 * far * near) / (near - far);
    const rows = [[...right, -dot(right, from)], [...up, -dot(up, from)], [...eye, -dot(eye, from)]];
    const m = new Float32Array(16);
    for (let i = 0; i < 4; i++) {
      m[4 * i] = rows[0][i] / (tan * aspect); m[4 * i + 1] = rows[1][i] / tan;
      m[4 * i + 2] = a * rows[2][i] + (i === 3 ? b : 0); m[4 * i + 3] = -rows[2][i];
    }
    return m;
  }

  // Where the ray through a point of the screen (x, y from -1 to 1) meets the undeformed organ: place and normal, or null.
  pick(x, y) {
    if (!this.rest) return null;
    const { eye, right, up, from, tan, aspect } = this.view();
    return this.cast(from, unit(along(along(along([0, 0, 0], right, x * tan * aspect), up, y * tan), eye, -1)), 1);
  }

  // Where a straight line into the undeformed organ leaves it again: place and normal, or null where the surface is open.
  opposite({ place, normal }) { return this.cast(along(place, normal, -1e-4), normal.map((x) => -x), -1); }

  // Where a ray first meets a side of the organ's surface. side: 1 outer, -1 inner.
  cast(from, ray, side) {
    const t = this.triangles, p = this.still;
    let best = Infinity, hit = null;
    for (let k = 0; k < t.length; k += 3) {
      const [i, j, l] = [3 * t[k], 3 * t[k + 1], 3 * t[k + 2]];
      const a = [p[i], p[i + 1], p[i + 2]], u = sub([p[j], p[j + 1], p[j + 2]], a), v = sub([p[l], p[l + 1], p[l + 2]], a);
      const h = cross(ray, v), d = dot(u, h);
      if (side * d < 1e-14) continue;
      const s = sub(from, a), f = dot(s, h) / d, q = cross(s, u), g = dot(ray, q) / d;
      if (f < 0 || g < 0 || f + g > 1) continue;
      const away = dot(v, q) / d;
      if (away > 0 && away < best) { best = away; hit = unit(cross(u, v)); }
    }
    return hit && { place: along(from, ray, best), normal: hit };
  }

  draw(fingers) {
    const gl = this.gl, ratio = this.sharp * Math.min(window.devicePixelRatio || 1, 1.5), box = this.canvas.getBoundingClientRect();
    const [w, h] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== h) { this.canvas.width = w; this.canvas.height = h; }
    gl.viewport(0, 0, w, h); gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.rest) return;
    const camera = this.camera(), { eye, lamp } = this.view();
    this.light(eye, lamp, [1, 1, 1]);
    gl.uniformMatrix4fv(this.at("camera"), false, camera);
    this.paint(this.organ, [1, 1, 1], this.full, 1);
    fingers.forEach((finger, number) => this.drawFinger(camera, finger, number));
  }

  // Mean displacement along the surface around a point of the undeformed surface, as in views/surface/moments.py: the fingertip is
  // drawn in its indentation, which friction drags along the surface.
  dragged(point, up) {
    const { still, places } = this, away = (i) => Math.hypot(still[3 * i] - point[0], still[3 * i + 1] - point[1], still[3 * i + 2] - point[2]);
    const reach = this.moved.reduce((least, i) => Math.min(least, away(i)), Infinity) + PATCH;
    const around = this.moved.filter((i) => away(i) <= reach), mean = [0, 0, 0];
    for (const i of around) for (let c = 0; c < 3; c++) mean[c] += (places[3 * i + c] - still[3 * i + c]) / around.length;
    return along(mean, up, -dot(mean, up));
  }

  // The fingertip as a ball, and the force on it as an arrow from the ball's surface with the number at its head: visible end-on.
  drawFinger(camera, { tip, up, foot: point, load: normal, force = [0, 0, 0] }, number) {
    const load = Math.hypot(...force), ball = along(normal > 0 ? along(tip, this.dragged(point, up), 1) : tip, up, RADIUS);
    if (!this.labels[number]) this.labels[0].after(this.labels[number] = this.labels[0].cloneNode());
    const label = this.labels[number];
    if (load > 0.02) {
      const scale = Math.min(1, this.size / SMALL), length = scale * Math.min(0.012 * load, 0.06);
      const way = unit(force), foot = along(ball, way, RADIUS), width = scale * (0.0022 + 0.0004 * Math.min(load, 4));
      this.paintAt(camera, this.arrow, foot, way, length, Math.min(width, 0.25 * length), ARROW, 1);
      this.beside(label, camera, along(foot, way, length), `${load.toFixed(2)} N`);
    } else write(label, "");
    this.paintAt(camera, this.ball, ball, up, RADIUS, RADIUS, BALL, 0.4);
  }

  // A text next to a point in space.
  beside(label, camera, point, text) {
    const at = [0, 1, 3].map((i) => camera[i] * point[0] + camera[4 + i] * point[1] + camera[8 + i] * point[2] + camera[12 + i]);
    const box = this.canvas.getBoundingClientRect();
    write(label, text);
    label.style.left = `${Math.min((0.5 + (0.5 * at[0]) / at[2]) * box.width, box.width - 70)}px`;
    label.style.top = `${Math.max((0.5 - (0.5 * at[1]) / at[2]) * box.height, 14)}px`;
  }

  paintAt(camera, part, place, axis, length, width, colour, alpha) {
    const side = unit(cross(Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], axis)), other = cross(axis, side), m = new Float32Array(16);
    const columns = [side.map((x) => x * width), other.map((x) => x * width), axis.map((x) => x * length), place];
    columns.forEach((c, j) => {
      for (let i = 0; i < 4; i++) m[4 * j + i] = camera[i] * c[0] + camera[4 + i] * c[1] + camera[8 + i] * c[2] + (j === 3 ? camera[12 + i] : 0);
    });
    const { eye, lamp } = this.view(), own = (a) => [dot(a, side), dot(a, other), dot(a, axis)];
    this.light(own(eye), own(lamp), [width, width, length]);
    this.gl.uniformMatrix4fv(this.at("camera"), false, m);
    this.paint(part, colour, 0, alpha);
  }

  // Set the directions to the viewer and to the lamp in the axes of a part, and the scale of the part along these axes.
  light(eye, lamp, stretch) {
    const gl = this.gl;
    gl.uniform3fv(this.at("eye"), eye); gl.uniform3fv(this.at("lamp"), lamp); gl.uniform3fv(this.at("stretch"), stretch);
  }

  paint(part, colour, full, alpha) {
    const gl = this.gl;
    gl[part.closed ? "enable" : "disable"](gl.CULL_FACE); gl[alpha < 1 ? "enable" : "disable"](gl.BLEND);
    gl.uniform3fv(this.at("base"), colour); gl.uniform1f(this.at("full"), full); gl.uniform1f(this.at("alpha"), alpha);
    gl.bindVertexArray(part.array); gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 0);
  }
}

// Quantities that colour a surface: whether a frame has it, least end of the scale, this end as text, a label if the key is unclear.
const KINDS = {
  displacement: { has: () => true, least: 4e-3, text: (v) => `${(1e3 * v).toFixed(1)} mm` },
  pressure: { has: ({ pressure, nodes }) => pressure.length || !nodes.length, least: 2e3, text: (v) => `${(1e-3 * v).toFixed(1)} kPa` },
  load: { has: ({ head }) => head.patch, least: 5e-3, text: (v) => `${(1e3 * v).toFixed(0)} mN`, name: "load on a vertex" },
  slip: { has: ({ head, nodes }) => head.slipped || !nodes.length, least: 1, text: () => "slides" },
  strain: { has: () => true, least: 0.05, text: (v) => `${(100 * v).toFixed(0)} %`, name: "largest strain of the surface" },
};

// Offer the colours that the frames contain.
export function offer(select, sent) { for (const option of select.options) option.hidden = !sent(option.value); }
export const sends = (newest) => (name) => Boolean(KINDS[name].has(newest));

// Deform and colour scenes by their newest frames, on one scale; returns its end, the end as text, and the label of the quantity.
export function painted(pairs, wish) {
  const of = pairs.every(([, newest]) => KINDS[wish].has(newest)) ? wish : "displacement", kind = KINDS[of];
  const length = (d) => Float32Array.from({ length: d.length / 3 }, (_, k) => Math.hypot(d[3 * k], d[3 * k + 1], d[3 * k + 2]));
  let most = kind.least;
  for (const [scene, newest] of pairs) {
    const { head, nodes, displacement, pressure } = newest;
    let values = { pressure, slip: head.slipped ?? [] }[of] ?? length(displacement);
    scene.carry(head.carried ?? []);
    scene.deform(nodes, displacement, values);
    if (of === "load") scene.colour(head.patch, values = head.loads);
    if (of === "strain") values = scene.strain();
    for (const v of values) if (v > most) most = v;
  }
  return { most, text: kind.text(most), what: of === wish ? kind.name ?? "" : `displacement (this body sends no ${wish})` };
}

// Rotate the vector at a place of an array by a matrix, row by row.
function rotate(vectors, k, r) {
  const x = vectors[k], y = vectors[k + 1], z = vectors[k + 2];
  for (let i = 0; i < 3; i++) vectors[k + i] = r[3 * i] * x + r[3 * i + 1] * y + r[3 * i + 2] * z;
}

// Whether each edge has a triangle on both sides. The back faces of a closed surface are never visible, and a software renderer
// takes half the time without them.
function closed(triangles) {
  const open = new Set(), most = 2 ** 26;
  for (let k = 0; k < triangles.length; k++) {
    const from = triangles[k], to = triangles[k % 3 < 2 ? k + 1 : k - 2];
    if (!open.delete(to * most + from)) open.add(from * most + to);
  }
  return !open.size;
}

// Whether WebGL is rendered in software, where antialiasing costs more than the rest of the picture.
function software() {
  const gl = document.createElement("canvas").getContext("webgl2"), about = gl?.getExtension("WEBGL_debug_renderer_info");
  return Boolean(about) && /swiftshader|llvmpipe|software/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL));
}

function turned(profile, count) {
  const places = [], normals = [], triangles = [], rows = profile.length;
  for (const [r, z, nr, nz] of profile) for (let k = 0; k < count; k++) {
    const a = (2 * Math.PI * k) / count;
    places.push(r * Math.cos(a), r * Math.sin(a), z); normals.push(nr * Math.cos(a), nr * Math.sin(a), nz);
  }
  for (let i = 0; i + 1 < rows; i++) for (let k = 0; k < count; k++) {
    const a = i * count + k, b = i * count + ((k + 1) % count);
    triangles.push(a, b, a + count, b, b + count, a + count);
  }
  return [new Float32Array(places), new Float32Array(normals), new Uint32Array(triangles)];
}

const sphere = (count) => turned(Array.from({ length: count / 2 + 1 }, (_, i) => {
  const a = (2 * Math.PI * i) / count - Math.PI / 2;
  return [Math.cos(a), Math.sin(a), Math.cos(a), Math.sin(a)];
}), count);

const pointer = (count) => turned([[0, 0, 0, -1], [0.5, 0, 1, 0], [0.5, 0.75, 1, 0], [1.3, 0.75, 0, -1], [1.3, 0.75, 0.25, 1.3], [0, 1, 0.25, 1.3]], count);
