// Reads a recording that a page made: what its pointers sent, and the messages that check the run of it. Others are compressed.

const MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const FOOTER = 2, CHANNEL = 4, MESSAGE = 5, CHUNK = 6, METADATA = 12, DATA_END = 15;
const PAGE = "palpate.page"; // metadata with the hash of the program that ran
const DAMAGED = "the file is damaged or no recording";

// bytes: a Uint8Array. Returns the hash of the program, the messages in order as [topic, tick, bytes], and the number of ticks.
export function readRecording(bytes) {
  if (MAGIC.some((value, k) => bytes[k] !== value)) throw new Error(DAMAGED);
  const found = { program: null, messages: [], ticks: 0 }, topics = new Map();
  for (const [kind, data] of records(bytes, MAGIC.length)) {
    if (kind === METADATA) {
      const name = data.text();
      if (name === PAGE) found.program = data.map().get("program") ?? null;
    } else if (kind === CHUNK) {
      data.at += 28; // times, size and checksum
      if (data.text() !== "") throw new Error("its data are compressed: expected a recording of a page; `palpate view` shows all others");
      data.at += 8;
      for (const [inner, record] of records(data.bytes, data.at)) {
        if (inner === CHANNEL) { const id = record.number(2); record.at += 2; topics.set(id, record.text()); }
        if (inner !== MESSAGE) continue;
        const topic = topics.get(record.number(2)), tick = record.number(4);
        if (topic === undefined) throw new Error(DAMAGED);
        found.messages.push([topic, tick, record.bytes.subarray(record.at + 16)]);
        found.ticks = Math.max(found.ticks, tick + 1);
      }
    }
  }
  if (!found.program) throw new Error("no page made it: expected a recording of this page; `palpate view` shows all others");
  return found;
}

function* records(bytes, at) {
  while (at < bytes.length) {
    const head = new Reader(bytes, at), kind = head.number(1), length = head.number(8), end = head.at + length;
    if (end > bytes.length) throw new Error(DAMAGED);
    if (kind === DATA_END || kind === FOOTER) return;
    yield [kind, new Reader(bytes.subarray(head.at, end), 0)];
    at = end;
  }
}

// Little-endian numbers and texts, in order.
class Reader {
  constructor(bytes, at) { this.bytes = bytes; this.at = at; }

  number(size) {
    if (this.at + size > this.bytes.length) throw new Error(DAMAGED);
    let value = 0;
    for (let k = size - 1; k >= 0; k--) value = 256 * value + this.bytes[this.at + k];
    this.at += size;
    return value;
  }

  text() {
    const length = this.number(4), begin = this.at;
    if (begin + length > this.bytes.length) throw new Error(DAMAGED);
    this.at += length;
    return new TextDecoder().decode(this.bytes.subarray(begin, this.at));
  }

  map() {
    const end = this.number(4) + this.at, entries = new Map();
    while (this.at < end) entries.set(this.text(), this.text());
    return entries;
  }
}

// Runs the touch of a recording again: what the pointers sent, at its ticks, and the check of the other messages.
export class Replay {
  // pointers: those of the variant; messages, ticks: as `readRecording` returns them.
  constructor(pointers, { messages, ticks }) {
    this.ticks = ticks; this.equal = this.different = 0;
    this.sent = new Map(); this.checks = new Map();
    const fingers = new Map(pointers.map(({ stream }, finger) => [stream, finger]));
    for (const [topic, tick, bytes] of messages) {
      const into = fingers.has(topic) ? this.sent : this.checks, one = fingers.has(topic) ? [fingers.get(topic), decoded(bytes)] : [topic, bytes];
      into.set(tick, [...(into.get(tick) ?? []), one]);
    }
  }

  // Before a step: left-out ticks are those without a message of a pointer. Returns false at the end.
  apply(tick, point, skip) {
    let next = tick.tick;
    while (next < this.ticks && !this.sent.has(next)) next++;
    if (next >= this.ticks) return false;
    if (next > tick.tick) skip(next - tick.tick);
    for (const [finger, { position, buttons, sample }] of this.sent.get(next)) point([sample, position, buttons], { finger });
    return true;
  }

  // After a step: compare the messages that the recording has of this tick.
  check(tick) {
    const expected = new Map(this.checks.get(tick.tick - 1));
    for (const { stream, bytes } of tick.messages()) {
      const one = expected.get(stream);
      if (one) this[one.length === bytes.length && one.every((byte, k) => byte === bytes[k]) ? "equal" : "different"]++;
    }
    tick.clear();
  }

  get outcome() {
    const whole = this.equal + this.different;
    return this.different ? `replayed: ${this.different} of ${whole} messages differ` : `replayed: all ${whole} compared messages equal`;
  }
}

// A message in msgpack (https://msgpack.org): a map of numbers, texts and arrays of these.
function decoded(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let at = 0;
  const sizes = { 0xcc: [1, "Uint8"], 0xcd: [2, "Uint16"], 0xce: [4, "Uint32"], 0xcf: [8, "BigUint64"], 0xd0: [1, "Int8"], 0xd1: [2, "Int16"], 0xd2: [4, "Int32"], 0xd3: [8, "BigInt64"], 0xca: [4, "Float32"], 0xcb: [8, "Float64"] };
  const text = (length) => { at += length; return new TextDecoder().decode(bytes.subarray(at - length, at)); };
  const value = () => {
    const kind = view.getUint8(at++);
    if (kind < 0x80) return kind;
    if (kind >= 0xe0) return kind - 256;
    if (kind < 0x90) return Object.fromEntries(Array.from({ length: kind & 15 }, () => [value(), value()]));
    if (kind < 0xa0) return Array.from({ length: kind & 15 }, value);
    if (kind < 0xc0) return text(kind & 31);
    if (kind === 0xd9) return text(view.getUint8(at++));
    if (!sizes[kind]) throw new Error(DAMAGED);
    const [size, name] = sizes[kind], number = Number(view[`get${name}`](at));
    at += size;
    return number;
  };
  const { position, buttons, sample } = value();
  if (!Array.isArray(position) || position.length !== 3 || ![...position, buttons, sample].every(Number.isFinite)) throw new Error(DAMAGED);
  return { position, buttons, sample };
}
