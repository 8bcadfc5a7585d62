// Frames of a tick for the page: the same message as `feed.frame` makes from a run in other processes.

const ZERO = [0, 0, 0];

// The newest messages as a frame; null before the first contact. shown: `page` of a variant; curves: of each finger times, forces
// and indentations since the last frame; late: ticks that were left out.
export function frame(tick, shown, curves, late) {
  if (shown.fingers.some(({ Contact }) => !tick.has(Contact))) return null;
  const [first, ...others] = shown.fingers.map((finger, k) => ({ ...now(tick, finger, shown.near[k], shown.thickness), ...curves[k] }));
  const { nodes, displacement, pressure, slipped } = surface(tick, shown);
  const head = { kind: "frame", late, ...first, others, ...pressed(tick, shown) };
  if (slipped) head.slipped = slipped;
  return packed(head, nodes, displacement, pressure);
}

// The last messages of a finger as plain data, as `feed.now`.
function now(tick, finger, near, thickness) {
  const { Contact, Pose, Friction, Force, ForceBand, Pointed, Pins, Spikes } = finger, read = (name, field) => tick.read(name, field);
  const head = {
    time: tick.when(Contact), normal: read(Contact, "normal"), foot: read(Contact, "foot"),
    load: read(Contact, "force"), depth: read(Contact, "indentation"), squeeze: read(Contact, "compression"),
  };
  const close = near.filter((name) => tick.has(name)).sort((a, b) => read(a, "gap") - read(b, "gap"))[0] ?? finger.Proximity;
  if (close && Pose && tick.has(close) && tick.has(Pose)) {
    head.up = read(close, "normal");
    head.tip = read(Pose, "position").map((p, i) => p - (thickness - head.squeeze) * head.up[i]);
  }
  if (Friction && tick.has(Friction)) Object.assign(head, { stick: read(Friction, "stick"), drag: Math.hypot(...read(Friction, "force")) });
  if (Force && tick.has(Force)) Object.assign(head, { force: read(Force, "force"), state: read(Force, "state"), energy: read(Force, "energy") });
  if (ForceBand && tick.has(ForceBand)) {
    const quantiles = read(ForceBand, "quantiles");
    Object.assign(head, { band: quantiles.length ? [quantiles[0], quantiles.at(-1)] : null, mean: read(ForceBand, "mean") });
  }
  if (Pointed) head.sample = tick.sample(Pointed);
  if (Pins && tick.has(Pins)) {
    const heights = read(Pins, "heights"), [rows, columns] = tick.shape(Pins, "heights");
    head.pins = Array.from({ length: rows }, (_, r) => [...heights.subarray(r * columns, (r + 1) * columns)]);
  }
  if (Spikes && tick.has(Spikes)) Object.assign(head, { rates: [...read(Spikes, "rate")], mean_rates: read(Spikes, "mean") });
  return head;
}

// The displaced vertices of all bodies on the joint mesh, with pressure and slip if all bodies send them.
function surface(tick, { bodies, first }) {
  const sent = bodies.map((name, k) => [name, first[k]]).filter(([name]) => tick.has(name));
  const each = sent.map(([name, begin]) => ({ name, begin, nodes: tick.read(name, "nodes") }));
  const nodes = Uint32Array.from(each.flatMap(({ nodes, begin }) => Array.from(nodes, (node) => node + begin)));
  const joined = (field) => each.map(({ name }) => tick.read(name, field));
  const whole = (field) => each.every(({ name, nodes }) => tick.read(name, field).length === nodes.length);
  const displacement = Float32Array.from(joined("displacement").flatMap((values) => [...values]));
  return {
    nodes, displacement: displacement.length === 3 * nodes.length ? displacement : new Float32Array(3 * nodes.length),
    pressure: Float32Array.from(whole("pressure") ? joined("pressure").flatMap((values) => [...values]) : []),
    slipped: nodes.length && whole("slipped") ? joined("slipped").flatMap((values) => [...values]) : null,
  };
}

// Vertices that loads press, and the size of each force [N].
function pressed(tick, { loads, first }) {
  const found = Object.entries(loads).filter(([name]) => tick.has(name)), patch = [], sizes = [];
  for (const [name, body] of found) {
    const forces = tick.read(name, "forces");
    tick.read(name, "nodes").forEach((node, k) => {
      patch.push(node + first[body]);
      sizes.push(Number(Math.hypot(...(forces.subarray(3 * k, 3 * k + 3) ?? ZERO)).toFixed(6)));
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
