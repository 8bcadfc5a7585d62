// The worker of the page: runs the tick with a fixed step at the pace of real time, and makes frames at the pace of the page.

import { unpacked } from "/files.js";
import { fillers, frame, meshOf } from "/frames.js";
import { Samples, record } from "/recording.js";
import { Replay } from "/replay.js";
import { Tick } from "/tick.js";

const TURN = 4; // [ms] between two turns
const BACKLOG = 100; // [ticks] that a turn runs at most; if more are due, all but the last are left out, as on the real clock
const FRAME = 1000 / 30; // [ms] between frames, at least
const FADING = 500; // [ms] that a hidden page goes on, while the finger that it has lifted leaves the organ; later ticks are left out
const COUNTED = 500; // [ticks] over which the time of a tick is averaged; the clock of a worker has steps of 0.1 ms
const known = new Map(); // parts and modules by their hash

let replay = null; // the recording that runs again
let tick = null, about = null, module = null, samples = null, filled = [], curves = [], late = 0;
let spent = 0, counted = 0, cost = 0; // [ms] and ticks since the time of a tick [s] was computed
let origin = 0, ran = 0, framed = 0, drawn = true, hidden = null;

const say = (text) => postMessage({ told: { kind: "status", text, keep: true, panel: null } });

const orders = {
  async file({ hash, text }) {
    try { known.set(hash, await unpacked(hash, text)); } catch (error) { known.set(hash, null); say(`stopped: the file ${hash} of this folder is damaged: ${error.message}`); }
    postMessage({ have: hash });
  },
  // Start a variant whose files have come.
  async begin({ hash, code, recording }) {
    if ([hash, code].some((one) => !known.get(one))) return;
    about = JSON.parse(new TextDecoder().decode(known.get(hash)));
    const needed = about.parts.map((part) => part.hash);
    if ([...needed, about.mesh].some((one) => !known.get(one))) return;
    if (known.get(code) instanceof Uint8Array) known.set(code, await WebAssembly.compile(known.get(code)));
    module = known.get(code);
    tick = new Tick(about, module, known);
    filled = fillers(about.page, meshOf(known.get(about.mesh)));
    restart();
    if (recording) again(recording);
  },
  reset() { tick.begin(); restart(); },
  point(sample, order) { if (!replay) point(sample, order); },
  hidden(on) {
    if (on) for (let finger = 0; tick && finger < about.pointers.length; finger++) orders.point([0, about.pointers[finger].begin, 0], { finger });
    if (!on && tick) {
      const gone = due(performance.now());
      if (gone > 0 && !replay) skip(gone);
      follow(); say(tick.failed ? failure() : "running");
    }
    hidden = on ? performance.now() : null;
  },
  drawn() { drawn = true; },
  download() {
    if (!tick) return;
    say("writing the recording");
    const parts = record(about, module, known, samples, tick.tick);
    postMessage({ file: { name: about.name, parts } }, parts.map((part) => part.buffer).filter((buffer, k, all) => all.indexOf(buffer) === k));
    follow(); say(tick.failed ? failure() : "running");
  },
};

// The files of a variant that have not come. Asked for by the page before `begin`.
orders.needs = ({ hash }) => {
  const text = known.get(hash) && JSON.parse(new TextDecoder().decode(known.get(hash)));
  postMessage({ needs: hash, hashes: text ? [...text.parts.map((part) => part.hash), text.mesh].filter((one) => !known.has(one)) : [] });
};

function point([sample, place, buttons], { finger }) {
  if (!tick || finger >= about.pointers.length || !place.every(Number.isFinite)) return;
  tick.point(finger, place, buttons, sample);
  samples.add(tick.tick, finger, place, buttons, sample);
}

function skip(count) {
  samples.skip(tick.tick, count);
  tick.skip(count);
}

// Run the touch of a recording of this variant again.
function again({ name, ...recording }) {
  try { replay = new Replay(about.pointers, recording); } catch (error) { say(`${name}: ${error.message}`); return; }
  const keep = new Map(about.recording.channels.map((channel) => [channel.topic, channel.keep]));
  tick.listen((stream) => keep.get(stream.name) ?? 0);
  say(`replaying ${name}`);
}

function restart() {
  replay = null;
  samples = new Samples(); late = spent = counted = cost = 0;
  const mesh = known.get(about.mesh).slice().buffer;
  postMessage({ came: mesh }, [mesh]);
  empty(); follow(); drawn = true;
  say("running");
}

const failure = () => `stopped: node '${tick.failed.node}' at tick ${tick.failed.tick}: ${tick.failed.why}; reset starts again`;

function empty() { curves = about.page.fingers.map(() => ({ t: [], f: [], s: [] })); }

// Go on from the present: real time that has passed without ticks does not count.
function follow() { origin = performance.now(); ran = 0; }

// Ticks that real time has reached and that have not run.
const due = (moment) => Math.floor(((moment - origin) * about.rate) / 1000) - ran;

function turn() {
  const moment = performance.now();
  if (tick && !tick.failed && (hidden === null || moment - hidden < FADING)) {
    let count = due(moment);
    if (count > BACKLOG) { if (!replay) { late += count - 1; skip(count - 1); } ran += count - 1; count = 1; }
    for (let k = 0; k < count; k++) if (!advance()) { say(failure()); break; }
    ran += count; spent += performance.now() - moment; counted += count;
    if (drawn && moment - framed >= FRAME) {
      if (counted >= COUNTED) { cost = (1e-3 * spent) / counted; spent = counted = 0; }
      const made = frame(tick, about.page, curves, { late, cost }, filled);
      if (made) { postMessage({ came: made }, [made]); empty(); drawn = false; framed = moment; }
    }
  }
  setTimeout(turn, TURN);
}

function advance() {
  if (replay && !replay.apply(tick, point, skip)) { say(replay.outcome); replay = null; tick.listen(() => 0); }
  const ok = tick.step(1) === 1;
  if (replay) replay.check(tick);
  about.page.fingers.forEach(({ Contact, Vibration }, k) => {
    if (Vibration && tick.has(Vibration) && tick.when(Vibration) === tick.when(Contact)) {
      const { vibration = [] } = curves[k];
      if (vibration.length < 60000) vibration.push(...Array.from(tick.read(Vibration, "lateral"), (force) => Math.round(1e6 * force) / 1e6));
      curves[k].vibration = vibration;
    }
    if (!tick.has(Contact)) return;
    const { t, f, s } = curves[k];
    if (t.length < 6000) { t.push(tick.when(Contact)); f.push(tick.read(Contact, "force")); s.push(tick.read(Contact, "indentation")); }
  });
  return ok;
}

onmessage = ({ data }) => { const name = Object.keys(orders).find((one) => one in data); if (name) orders[name](data[name], data); };
turn();
