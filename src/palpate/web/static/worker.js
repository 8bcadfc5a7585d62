// The worker of the page: runs the tick with a fixed step at the pace of real time, and makes frames at the pace of the page.

import { unpacked } from "/files.js";
import { fillers, frame, meshOf } from "/frames.js";
import { RawHid } from "/raw_hid.js";
import { Samples, record } from "/recording.js";
import { Replay } from "/replay.js";
import { Tick } from "/tick.js";

const TURN = 4; // [ms] between two turns
const BACKLOG = 100; // [ticks] that a turn runs at most; if more are due, all but the last are left out, as on the real clock
const FRAME = 1000 / 30; // [ms] between frames, at least
const FADING = 500; // [ms] that a hidden page goes on, while the finger that it has lifted leaves the organ; later ticks are left out
const COUNTED = 500; // [ticks] over which the time of a tick is averaged; the clock of a worker has steps of 0.1 ms
const known = new Map(); // data and modules by their hash

let device = null, port = null, halted = false; // the raw-HID device and its connection, while it is open; whether its run has ended
let replay = null; // the recording that runs again
let tick = null, about = null, module = null, samples = null, filled = [], curves = [], late = 0;
let spent = 0, counted = 0, cost = 0; // [ms] and ticks since the time of a tick [s] was computed
let origin = 0, ran = 0, framed = 0, drawn = true, hidden = null;

const nanoseconds = (moment = performance.now()) => Math.round(1e6 * moment);
const say = (text) => postMessage({ told: { kind: "status", text, keep: true, panel: null } });

const orders = {
  async file({ hash, text }) {
    try {
      for (const [key, data] of await unpacked(hash, text)) known.set(key, data);
      postMessage({ have: hash });
    } catch ({ message }) { postMessage({ have: hash, why: message }); }
  },
  // Start a variant whose files are known.
  async begin({ hash, code, recording, device: wanted }) {
    about = JSON.parse(new TextDecoder().decode(known.get(hash)));
    if (known.get(code) instanceof Uint8Array) known.set(code, await WebAssembly.compile(known.get(code)));
    module = known.get(code);
    tick = new Tick(about, module, known);
    filled = fillers(about.page, meshOf(known.get(about.mesh)));
    restart();
    if (recording) again(recording);
    if (wanted) open(wanted);
  },
  reset() { tick.begin(); restart(); },
  // Leave the device: the force fades first.
  device() { if (device) device.stop(); else ended(""); },
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

function point([sample, place, buttons], { finger }) {
  if (!tick || finger >= about.pointers.length || !place.every(Number.isFinite)) return;
  tick.point(finger, place, buttons, sample);
  samples.add(tick.tick, finger, place, buttons, sample);
}

// Open a device that the user has chosen, and exchange reports with it.
async function open({ vendorId, productId, usagePage, usage }) {
  try {
    const fits = (one) => one.vendorId === vendorId && one.productId === productId && one.collections.some((each) => each.usagePage === usagePage && each.usage === usage);
    if (!navigator.hid) throw new Error("this browser gives workers no HID devices");
    const found = (await navigator.hid.getDevices()).find(fits);
    if (!found) throw new Error("the browser no longer has it");
    if (!found.opened) await found.open();
    port = found;
    port.oninputreport = ({ data }) => heard(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    navigator.hid.ondisconnect = ({ device: gone }) => { if (gone === port) device?.lose("it is disconnected"); };
    device = new RawHid(about.devices[0], (bytes) => found.sendReport(0, bytes).catch(({ message }) => device?.lose(message)), ended, nanoseconds());
  } catch (error) { ended(error.message); }
}

// A report has come: after an answer, the ticks that are due run, and their command is sent.
function heard(bytes) {
  if (!device?.take(bytes, nanoseconds())) return;
  run(performance.now());
  device.next(nanoseconds());
}

// The exchange with the device has ended; the run of a device does not go on without it.
async function ended(why) {
  device = null; halted = true;
  const gone = port;
  port = null;
  if (gone) { gone.oninputreport = null; try { await gone.close(); } catch { /* it is unplugged */ } }
  postMessage({ ended: why });
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
  replay = null; halted = false; device?.hold();
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

const runs = (moment) => tick && !tick.failed && !halted && (hidden === null || moment - hidden < FADING);

// Run the ticks that are due.
function run(moment) {
  if (!runs(moment)) return;
  let count = due(moment);
  if (count > BACKLOG) { if (!replay) { late += count - 1; skip(count - 1); } ran += count - 1; count = 1; }
  for (let k = 0; k < count; k++) if (!advance()) { say(failure()); break; }
  ran += count; spent += performance.now() - moment; counted += count;
}

function turn() {
  const moment = performance.now();
  run(moment);
  if (device?.poll(nanoseconds())) device.next(nanoseconds());
  if (runs(moment)) {
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
  if (device) { const sample = device.sample(nanoseconds()); tick.sense(0, sample); samples.sense(tick.tick, sample); }
  const ok = tick.step(1) === 1;
  if (device && ok && hidden === null) obey();
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

// The device gets the command of this tick. A failed or hidden run gives none, so that the guard lets the force fade.
function obey() {
  const { command: { stream, field } } = about.devices[0];
  if (tick.has(stream)) device.command(tick.read(stream, field), nanoseconds());
}

onmessage = ({ data }) => { const name = Object.keys(orders).find((one) => one in data); if (name) orders[name](data[name], data); };
turn();
