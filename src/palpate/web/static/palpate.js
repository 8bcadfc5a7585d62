// palpate in a program of yours: load a folder of `palpate build web`, move fingers, read forces and the surface. Types: palpate.d.ts.

import { quoted, unpacked } from "/files.js";
import { fillers, frame, headOf, meshOf } from "/frames.js";
import { Samples, record } from "/recording.js";
import { Tick } from "/tick.js";

const fetched = (folder) => async (name) => {
  const answer = await fetch(`${folder}/${name}`);
  if (!answer.ok) throw new Error(`${folder}/${name}: ${answer.status} ${answer.statusText}`);
  return answer.text();
};

// Load a variant of a folder. folder: its address, or a function that returns the text of a file; the others: as in the page.
export async function load(folder, { scene, organ, body, effects = {}, hard = null } = {}) {
  const read = typeof folder === "function" ? folder : fetched(folder);
  const site = JSON.parse(/= (.*);\s*$/s.exec(await read("site.js"))[1]);
  const begin = site.variants.find((one) => one.first), place = { scene: scene ?? begin.scene, organ: organ ?? begin.organ };
  const here = site.variants.filter((one) => one.scene === place.scene && one.organ === place.organ), first = here.find((one) => one.first) ?? begin;
  const wish = { ...first.effects, ...effects }, last = (name) => name.split(".").pop();
  const fits = (one) => last(one.body) === last(body ?? first.body) && one.case === hard && !one.device && Object.entries(wish).every(([name, on]) => one.effects[name] === on);
  const variant = here.find(fits);
  if (!variant) throw new Error(`no such variant; this folder has ${site.variants.map((one) => `${[one.scene, one.organ, one.case].filter(Boolean).map((name) => `${name} `).join("")}${one.body} ${JSON.stringify(one.effects)}`).join(", ")}`);
  const data = new Map();
  await Promise.all(variant.files.map(async (hash) => {
    const name = `data/${hash}.js`;
    try { for (const [key, bytes] of await unpacked(hash, quoted(await read(name)))) data.set(key, bytes); } catch (error) { throw new Error(`${name}: ${error.message}`); }
  }));
  const about = JSON.parse(new TextDecoder().decode(data.get(variant.hash)));
  return new Touch(about, await WebAssembly.compile(data.get(site.code)), data, data.get(about.mesh), variant);
}

export class Touch {
  constructor(about, module, parts, mesh, { body, effects }) {
    Object.assign(this, { about, module, parts, body, effects });
    this.tick = new Tick(about, module, parts);
    this.samples = new Samples();
    this.number = 0;
    this.mesh = meshOf(mesh);
    this.head = headOf(mesh);
  }

  get time() { return this.tick.tick / this.about.rate; }
  get rate() { return this.about.rate; }
  get fingers() { return this.about.pointers.length; }
  get thickness() { return this.about.page.thickness; }
  get failed() { return this.tick.failed; }

  // Begin again from the start.
  begin() { this.tick.begin(); this.samples = new Samples(); this.number = 0; }

  // Set the target [m, world] that a finger follows.
  point(place, { finger = 0, buttons = 0 } = {}) {
    if (!(finger >= 0 && finger < this.fingers)) throw new RangeError(`finger: found ${finger}, expected 0 to ${this.fingers - 1}`);
    if (place.length !== 3 || !place.every(Number.isFinite)) throw new TypeError(`place: found ${place}, expected three numbers in metres`);
    this.tick.point(finger, place, buttons, ++this.number);
    this.samples.add(this.tick.tick, finger, place, buttons, this.number);
  }

  // Leave out time [s], as a run on the real clock does when it is late: the force ramps up from zero after it.
  skip(seconds) {
    const count = Math.round(seconds * this.rate);
    this.samples.skip(this.tick.tick, count);
    this.tick.skip(count);
  }

  // Run `seconds` of simulated time, by default one tick. Returns whether no node failed.
  step(seconds = 1 / this.rate) {
    const ticks = Math.max(1, Math.round(seconds * this.rate));
    return this.tick.step(ticks) === ticks;
  }

  // The contact of a finger: force on the hand [N], normal force [N], indentation [m], foot point [m], normal, whether it sticks.
  contact(finger = 0) {
    const { Contact, Friction, Force } = this.about.page.fingers[finger], { tick } = this, has = (name) => name && tick.has(name);
    if (!has(Contact)) return null;
    return {
      force: has(Force) ? tick.read(Force, "force") : [0, 0, 0], load: tick.read(Contact, "force"), indentation: tick.read(Contact, "indentation"),
      foot: tick.read(Contact, "foot"), normal: tick.read(Contact, "normal"), sticks: has(Friction) ? tick.read(Friction, "stick") : null,
    };
  }

  // The displaced vertices of a body, of the mesh, and their displacements [m]: arrays that show the memory of the tick, not copies.
  surface(body = 0) {
    const name = this.about.page.bodies[body];
    return this.tick.has(name) ? { nodes: this.tick.read(name, "nodes"), displacement: this.tick.read(name, "displacement"), first: this.about.page.first[body] } : null;
  }

  // The state as a message to the page, for programs that draw as the page does: `feed.pack_message` describes it.
  frame() {
    this.filled ??= fillers(this.about.page, this.mesh);
    return frame(this.tick, this.about.page, this.about.page.fingers.map(() => ({ t: [], f: [], s: [] })), { late: 0 }, this.filled);
  }

  // A field of the newest message of any stream.
  read(stream, field) { return this.tick.read(stream, field); }

  // The recording of everything since the start, as a Blob of an MCAP file for `palpate replay`.
  recording() { return new Blob(record(this.about, this.module, this.parts, this.samples, this.tick.tick)); }
}
