// A device of the open raw-HID protocol (docs/raw_hid.md), as drivers/hid/raw.py and drivers/exchange.py: one command after each
// answer or after a timeout, all of them through the guard. The page passes reports to and from the browser. Times in ns.

import { Guard } from "/guard.js";

const KINDS = { B: [1, "Uint8"], H: [2, "Uint16"], h: [2, "Int16"], I: [4, "Uint32"], i: [4, "Int32"], f: [4, "Float32"] };
const ASKING = 1e9, AGAIN = 80e6; // [ns] to wait for the description of the device, and between two requests for it
const BITS = 16; // of a report's buttons

// CRC-16/X-25 of bytes; 0x906E for "123456789".
export function crc16(bytes) {
  let sum = 0xffff;
  for (const byte of bytes) { sum ^= byte; for (let k = 0; k < 8; k++) sum = sum & 1 ? 0x8408 ^ (sum >>> 1) : sum >>> 1; }
  return sum ^ 0xffff;
}

// The bytes of a report. about: `describe_protocol` of web/device.py.
export function pack(about, name, values) {
  const { kind, fields } = about.reports[name], bytes = new Uint8Array(about.length), view = new DataView(bytes.buffer);
  bytes[0] = about.magic; bytes[1] = kind;
  for (const [field, { type, at, count }] of Object.entries(fields)) {
    const [size, form] = KINDS[type], given = [values[field]].flat();
    for (let k = 0; k < count; k++) view[`set${form}`](at + k * size, given[k] ?? 0, true);
  }
  view.setUint16(about.length - 2, crc16(bytes.subarray(0, -2)), true);
  return bytes;
}

// The name and fields of a report; null: it is invalid.
export function unpack(about, bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), end = about.length - 2;
  if (bytes.length !== about.length || bytes[0] !== about.magic || crc16(bytes.subarray(0, end)) !== view.getUint16(end, true)) return null;
  const found = Object.entries(about.reports).find(([, { kind }]) => kind === bytes[1]);
  if (!found) return null;
  const [name, { fields }] = found, values = { name };
  for (const [field, { type, at, count }] of Object.entries(fields)) {
    const [size, form] = KINDS[type], all = Array.from({ length: count }, (_, k) => view[`get${form}`](at + k * size, true));
    values[field] = count > 1 ? all : all[0];
  }
  return values;
}

export class RawHid {
  // about: a device of the variant; send: takes the bytes of a report; ended: called at the end with the reason, "" after `stop`.
  constructor(about, send, ended, now) {
    Object.assign(this, { protocol: about.protocol, rules: about.exchange, send, ended });
    this.guard = new Guard(about.guard);
    this.phase = "asking"; this.why = ""; this.begun = now; this.number = 0; this.left = 0; this.pending = true;
    this.wanted = { command: [0, 0, 0], given: 0 };
    this.newest = null; this.last = -1; this.measured = -1; this.since = 0; this.then = now; this.quiet = 0;
    this.ask(now);
  }

  get running() { return this.phase === "running"; }

  // Set the command [N] or [N m] to send from now on.
  command(values, now) { this.wanted = { command: [...values], given: now }; }

  // The run begins again: the force falls until it gives a command.
  hold() { this.wanted.given = 0; }

  // Let the force fade, send zeros, and end.
  stop() {
    if (this.phase === "running") { this.phase = "fading"; this.left = this.rules.fading; } else if (this.phase === "asking") this.end();
  }

  // The device is no longer there.
  lose(why) { this.why ||= why; this.end(); }

  // Take a report. Returns whether it is an answer, after which `next` sends a command.
  take(bytes, now) {
    const report = this.phase === "closed" ? null : unpack(this.protocol, bytes);
    if (report?.name === "info" && this.phase === "asking") return this.open(report, now);
    if (report?.name !== "state" || this.phase === "asking" || !this.isNewer(report.sequence)) return false;
    this.answered(this.sampled(report, now), now);
    return this.phase !== "closed";
  }

  // Note a missing answer. Returns whether `next` must send a command.
  poll(now) {
    if (this.phase === "closed") return false;
    if (this.phase !== "asking") {
      if (!this.pending || now - this.asked <= this.rules.patience * 1e9) return false;
      this.answered(null, now);
      return this.phase !== "closed";
    }
    if (now - this.begun > ASKING) this.lose(`it does not answer as docs/raw_hid.md says. Is its firmware of version ${this.protocol.version}?`);
    else if (now - this.asked > AGAIN) this.ask(now);
    return false;
  }

  // Send the next command.
  next(now) {
    const zero = this.wanted.command.map(() => 0);
    if (this.phase === "running") return this.write(this.guard.apply(this.wanted.command, now, this.wanted.given), now);
    if (this.phase === "fading") {
      const sent = this.guard.apply(this.wanted.command, now, 0);
      if (this.left-- > 0 && sent.some((c) => c !== 0)) return this.write(sent, now);
      this.phase = "farewell"; this.left = this.rules.farewell;
    }
    if (this.left-- > 0) this.write(zero, now); else this.end();
  }

  // The newest sample, extrapolated to `now` by at most the horizon, as a message; not homed before the first one.
  sample(now) {
    const { sample, rates } = this.newest ?? {};
    if (!sample?.homed) return { joints: [], position: [], buttons: sample?.buttons ?? 0, homed: false, age: 0 };
    const horizon = this.rules.horizon, left = Math.min(Math.max((now - sample.time) * 1e-9, 0), horizon);
    const ahead = (name) => sample[name].map((x, i) => (rates[name].length ? x + rates[name][i] * left : x));
    const age = Math.max(Math.round(now - sample.time - horizon * 1e9), 0);
    return { joints: ahead("joints"), position: sample.joints.length ? [] : ahead("position"), buttons: sample.buttons, homed: true, age };
  }

  ask(now) { this.report(this.protocol.flags.ask, [], now); }

  open(info, now) {
    const { axes } = this.protocol, scales = [...info.per_count.slice(0, info.axes), ...info.per_unit.slice(0, info.axes)];
    if (!(info.axes >= 1 && info.axes <= axes)) this.lose(`it has ${info.axes} axes, expected 1 to ${axes}`);
    else if (!scales.every((s) => Number.isFinite(s) && s !== 0)) this.lose(`it reports scales of ${scales.join(", ")}, expected none to be 0: check its firmware`);
    else { this.info = info; this.phase = "running"; this.then = now; }
    return this.running;
  }

  // The sample in a state; not homed if its numbers are invalid.
  sampled({ flags, counts, buttons, time }, now) {
    const { homed, fault, torques } = this.protocol.flags, [low, high] = this.protocol.counts, { axes, per_count: scale } = this.info;
    if (time === 0 || time !== this.measured) { this.measured = time; this.since = now; }
    if (flags & fault && this.phase === "running") { this.why = "it reports a fault. Switch it off and on; check its firmware"; this.stop(); }
    const used = counts.slice(0, axes), frozen = now - this.since > this.guard.about.silent * 1e9;
    const none = { time: now, joints: [], position: [], buttons, homed: false };
    if (!(flags & homed) || flags & fault || used.some((n) => n < low || n > high) || frozen) return none;
    const place = [0, 1, 2].map((i) => (i < axes ? used[i] * scale[i] : 0)), angular = this.info.flags & torques;
    return { ...none, time: this.since, homed: true, joints: angular ? place : [], position: angular ? [] : place };
  }

  // Whether a sequence number is newer than the last one: up to half of the numbers are.
  isNewer(number) {
    const { numbers } = this.protocol, ahead = (number - this.last + numbers) % numbers;
    if (this.last >= 0 && !(ahead > 0 && ahead <= numbers / 2)) return false;
    this.last = number;
    return true;
  }

  answered(sample, now) {
    this.pending = false;
    this.guard.noteAnswer(sample);
    this.quiet += Math.min((now - this.then) * 1e-9, this.rules.silence / this.rules.least);
    this.then = now;
    if (sample) { this.newest = { sample, rates: this.guard.rates() }; this.quiet = 0; }
    else if (this.quiet > this.rules.silence) this.lose("it does not answer any more. Check its power and connection");
  }

  // Send a command [N] or [N m] in the device's units; one outside their range is scaled as a whole.
  write(command, now) {
    const raw = command.slice(0, this.info.axes).map((c, i) => c / this.info.per_unit[i]), scale = Math.min(1, 32767 / Math.max(...raw.map(Math.abs), 1));
    const { enable, home } = this.protocol.flags;
    this.report(enable | home, raw.map((r) => even(scale * r)), now);
  }

  report(flags, values, now) {
    const { version, watchdog } = this.protocol;
    this.number = (this.number + 1) & 0xffff; this.asked = now; this.pending = true;
    this.send(pack(this.protocol, "command", { sequence: this.number, flags, version, watchdog, values }));
  }

  end() { if (this.phase !== "closed") { this.phase = "closed"; this.ended(this.why); } }
}

// The nearest integer; of two equally near ones the even one.
function even(x) {
  const near = Math.round(x);
  return near - x === 0.5 && near % 2 ? near - 1 : near;
}

// A sample in three numbers and one of flags, as the page keeps it for a recording, and back.
export const kept = ({ joints, position, buttons, homed, age }) => [joints.length ? joints : homed ? position : [0, 0, 0], buttons + 2 ** BITS * (homed + 2 * (joints.length > 0)), age];
export function restored(numbers, mask, age) {
  const flags = mask >>> BITS, homed = Boolean(flags & 1), jointed = Boolean(flags & 2);
  return { joints: jointed ? numbers : [], position: homed && !jointed ? numbers : [], buttons: mask & (2 ** BITS - 1), homed, age };
}
