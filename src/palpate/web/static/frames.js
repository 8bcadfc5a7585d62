// Frames of a tick for the page: the same message as `feed.frame` makes from a run in other processes.

import { Carried, STILL } from "/carried.js";
import { Filled } from "/fill.js";

// The head of a message to the page.
export const headOf = (bytes) => JSON.parse(new TextDecoder().decode(bytes.subarray(4, endOfHead(bytes))));
const endOfHead = (bytes) => 4 + new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);

// The arrays of a message to the page with a mesh: triangles, vertices, normals.
export function meshOf(bytes) {
  const [triangles, vertices, normals] = headOf(bytes).sizes, from = bytes.byteOffset + endOfHead(bytes);
  return {
    triangles: new Uint32Array(bytes.buffer, from, triangles), vertices: new Float32Array(bytes.buffer, from + 4 * triangles, vertices),
    normals: new Float32Array(bytes.buffer, from + 4 * (triangles + vertices), normals),
  };
}

// What fills the surface of each body that sends a sample of its vertices.
export function fillers({ first, landmarks }, { vertices }) {
  return first.map((begin, k) => new Filled(vertices.slice(3 * begin, first[k + 1] === undefined ? undefined : 3 * first[k + 1]), landmarks[k]));
}

// The newest messages as a frame; null before the first contact. shown: `page` of a variant; curves: of each finger times, forces
// and indentations since the last frame; measured: `late`, the ticks that were left out, and `cost`, the
// time of a tick [s]; filled: `fillers` of the mesh.
export function frame(tick, shown, curves, measured, filled) {
  if (shown.fingers.some(({ Contact }) => !tick.has(Contact))) return null;
  const [first, ...others] = shown.fingers.map((finger, k) => ({ ...now(tick, finger, nearest(tick, shown, k), shown.thickness), ...curves[k] }));
  const { nodes, displacement, pressure, slipped } = surface(tick, shown, filled);
  const head = { kind: "frame", ...measured, ...first, others, ...pressed(tick, shown) };
  const moved = shown.carried.map(([begin, end, motion]) => [begin, end, Carried.by(tick, motion)]).filter(([, , by]) => by);
  if (moved.length) head.carried = moved.map(([begin, end, by]) => [begin, end, by.way, ...(by.turn ? [by.turn] : [])]);
  if (slipped) head.slipped = slipped;
  return packed(head, nodes, displacement, pressure);
}

// The stream with the smallest gap to a finger, and that of the motion in whose frame it is.
function nearest(tick, { near, supports }, finger) {
  const gaps = near[finger].map((name, k) => [name, supports[finger][k]]).filter(([name]) => tick.has(name));
  return gaps.sort(([a], [b]) => tick.read(a, "gap") - tick.read(b, "gap"))[0] ?? [];
}

// The last messages of a finger as plain data, as `feed.now`.
function now(tick, finger, [near, motion], thickness) {
  const { Contact, Pose, Friction, Force, ForceBand, Pointed, Pins, Spikes, Vibration } = finger, read = (name, field) => tick.read(name, field);
  const organ = Carried.by(tick, motion) ?? STILL;
  const head = {
    time: tick.when(Contact), normal: organ.vector(read(Contact, "normal")), foot: organ.point(read(Contact, "foot")),
    load: read(Contact, "force"), depth: read(Contact, "indentation"), squeeze: read(Contact, "compression"),
  };
  const close = near ?? finger.Proximity;
  if (close && Pose && tick.has(close) && tick.has(Pose)) {
    head.up = organ.vector(read(close, "normal"));
    head.tip = read(Pose, "position").map((p, i) => p - (thickness - head.squeeze) * head.up[i]);
  }
  if (Friction && tick.has(Friction)) Object.assign(head, { stick: read(Friction, "stick"), drag: Math.hypot(...read(Friction, "force")) });
  if (Force && tick.has(Force)) Object.assign(head, { force: organ.vector(read(Force, "force")), state: read(Force, "state"), energy: read(Force, "energy") });
  if (ForceBand && tick.has(ForceBand)) {
    const quantiles = read(ForceBand, "quantiles");
    Object.assign(head, { band: quantiles.length ? [quantiles[0], quantiles.at(-1)] : null, mean: read(ForceBand, "mean") });
  }
  if (Vibration && tick.has(Vibration)) head.sampling = read(Vibration, "sampling");
  if (Pointed) head.sample = tick.sample(Pointed);
  if (Pins && tick.has(Pins)) {
    const heights = read(Pins, "heights"), [rows, columns] = tick.shape(Pins, "heights");
    head.pins = Array.from({ length: rows }, (_, r) => [...heights.subarray(r * columns, (r + 1) * columns)]);
  }
  if (Spikes && tick.has(Spikes)) Object.assign(head, { rates: [...read(Spikes, "rate")], mean_rates: read(Spikes, "mean") });
  return head;
}

// The displaced vertices of all bodies on the joint mesh, with pressure and slip if all bodies send them.
function surface(tick, { bodies, first }, filled) {
  const sent = bodies.map((name, k) => ({ name, begin: first[k], fill: filled[k] })).filter(({ name }) => tick.has(name));
  for (const one of sent) {
    const read = (field) => tick.read(one.name, field), nodes = read("nodes"), moved = read("displacement"), all = one.fill.fill(nodes, moved);
    one.nodes = all ? Int32Array.from({ length: all.length / 3 }, (_, v) => v) : nodes;
    one.displacement = all ?? moved;
    for (const field of ["pressure", "slipped"]) {
      const values = read(field);
      one[field] = all && values.length === nodes.length ? spread(nodes, values, all.length / 3) : values;
    }
  }
  const count = sent.reduce((sum, { nodes }) => sum + nodes.length, 0), nodes = new Uint32Array(count);
  let at = 0;
  for (const one of sent) { one.nodes.forEach((node, k) => { nodes[at + k] = node + one.begin; }); at += one.nodes.length; }
  const joined = (field, each) => {
    const whole = sent.every((one) => one[field].length === each * one.nodes.length), values = new Float32Array(whole ? each * count : 0);
    let to = 0;
    for (const one of whole ? sent : []) { values.set(one[field], to); to += one[field].length; }
    return values;
  };
  const displacement = joined("displacement", 3), slipped = joined("slipped", 1);
  return {
    nodes, displacement: displacement.length ? displacement : new Float32Array(3 * count),
    pressure: joined("pressure", 1), slipped: slipped.length ? [...slipped] : null,
  };
}

function spread(nodes, values, count) {
  const all = new Float64Array(count);
  nodes.forEach((node, k) => { all[node] = values[k]; });
  return all;
}

// Vertices that loads press, and the size of each force [N].
function pressed(tick, { loads, first }) {
  const found = Object.entries(loads).filter(([name]) => tick.has(name)), patch = [], sizes = [];
  for (const [name, body] of found) {
    const forces = tick.read(name, "forces");
    tick.read(name, "nodes").forEach((node, k) => {
      patch.push(node + first[body]);
      sizes.push(Number(Math.hypot(...(forces.subarray(3 * k, 3 * k + 3))).toFixed(6)));
    });
  }
  return found.length ? { patch, loads: sizes } : {};
}

// One message to the page, as `feed.pack_message`.
export function packed(head, indices, first, second) {
  const text = new TextEncoder().encode(JSON.stringify({ ...head, sizes: [indices.length, first.length, second.length] }));
  const length = Math.ceil(text.length / 4) * 4, at = 4 + length;
  const buffer = new ArrayBuffer(at + 4 * (indices.length + first.length + second.length)), bytes = new Uint8Array(buffer);
  bytes.fill(32, 4, at); bytes.set(text, 4);
  new DataView(buffer).setUint32(0, length, true);
  new Uint32Array(buffer, at, indices.length).set(indices);
  new Float32Array(buffer, at + 4 * indices.length, first.length).set(first);
  new Float32Array(buffer, at + 4 * (indices.length + first.length), second.length).set(second);
  return buffer;
}
