// The worker of the page: runs the tick with a fixed step at the pace of real time, and makes frames at the pace of the page.

import { unpacked } from "/files.js";
import { fillers, frame, meshOf } from "/frames.js";
import { Samples, record } from "/recording.js";
import { Tick } from "/tick.js";

const TURN = 4; // [ms] between two turns
const BACKLOG = 100; // [ticks] that a turn runs at most; what is due beyond them is left out of real time, and counted as late
const FRAME = 1000 / 30; // [ms] between frames, at least
const FADING = 500; // [ms] that a hidden page goes on, while the finger that it has lifted leaves the organ
const known = new Map(); // parts and modules by their hash

let tick = null, about = null, module = null, samples = null, filled = [], curves = [], late = 0;
let origin = 0, ran = 0, framed = 0, drawn = true, hidden = null;

const say = (text) => postMessage({ told: { kind: "status", text, keep: true, panel: null } });

const orders = {
  async file({ hash, text }) {
    try { known.set(hash, await unpacked(hash, text)); } catch (error) { known.set(hash, null); say(`stopped: the file ${hash} of this folder is damaged: ${error.message}`); }
    postMessage({ have: hash });
  },
  // Start a variant whose files have come.
  async begin({ hash, code }) {
    if ([hash, code].some((one) => !known.get(one))) return;
    about = JSON.parse(new TextDecoder().decode(known.get(hash)));
    const needed = about.parts.map((part) => part.hash);
    if ([...needed, about.mesh].some((one) => !known.get(one))) return;
    if (known.get(code) instanceof Uint8Array) known.set(code, await WebAssembly.compile(known.get(code)));
    module = known.get(code);
    tick = new Tick(about, module, known);
    filled = fillers(about.page, meshOf(known.get(about.mesh)));
    restart();
  },
  reset() { tick.begin(); restart(); },
  point([sample, place, buttons], { finger }) {
    if (!tick || finger >= about.pointers.length || !place.every(Number.isFinite)) return;
    tick.point(finger, place, buttons, sample);
    samples.add(tick.tick, finger, place, buttons, sample);
  },
  hidden(on) {
    if (on) for (let finger = 0; tick && finger < about.pointers.length; finger++) orders.point([0, about.pointers[finger].begin, 0], { finger });
    hidden = on ? performance.now() : null;
    if (!on && tick) { follow(); say(tick.failed ? failure() : "running"); }
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

function restart() {
  samples = new Samples(); late = 0;
  const mesh = known.get(about.mesh).slice().buffer;
  postMessage({ came: mesh }, [mesh]);
  empty(); follow(); drawn = true;
  say("running");
}

const failure = () => `stopped: node '${tick.failed.node}' at tick ${tick.failed.tick}: ${tick.failed.why}; reset starts again`;

function empty() { curves = about.page.fingers.map(() => ({ t: [], f: [], s: [] })); }

// Go on from the present: real time that has passed without ticks does not count.
function follow() { origin = performance.now(); ran = 0; }

function turn() {
  const moment = performance.now();
  if (tick && !tick.failed && (hidden === null || moment - hidden < FADING)) {
    let due = Math.floor(((moment - origin) * about.rate) / 1000) - ran;
    if (due > BACKLOG) { late += due - BACKLOG; ran += due - BACKLOG; due = BACKLOG; }
    for (let k = 0; k < due; k++) if (!advance()) { say(failure()); break; }
    ran += due;
    if (drawn && moment - framed >= FRAME) {
      const made = frame(tick, about.page, curves, late, filled);
      if (made) { postMessage({ came: made }, [made]); empty(); drawn = false; framed = moment; }
    }
  }
  setTimeout(turn, TURN);
}

function advance() {
  const ok = tick.step(1) === 1;
  about.page.fingers.forEach(({ Contact }, k) => {
    if (!tick.has(Contact)) return;
    const { t, f, s } = curves[k];
    if (t.length < 6000) { t.push(tick.when(Contact)); f.push(tick.read(Contact, "force")); s.push(tick.read(Contact, "indentation")); }
  });
  return ok;
}

onmessage = ({ data }) => { const name = Object.keys(orders).find((one) => one in data); if (name) orders[name](data[name], data); };
turn();
