// A recording of a touch in the page: an MCAP file (https://mcap.dev) that `palpate replay` reads.
//
// The page keeps only what its pointers sent. The tick is run again from the start with these, which gives the same bytes, and its
// messages go into the file: all of the pointers, and of the other streams one in 0.2 s, as a check for whoever computes them again.

import { kept, restored } from "/raw_hid.js";
import { Tick } from "/tick.js";

const MAGIC = Uint8Array.of(0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a);
const HEADER = 1, FOOTER = 2, SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, CHUNK = 6, STATISTICS = 11, METADATA = 12, METADATA_INDEX = 13, DATA_END = 15;
const ROOM = 1 << 20; // [bytes] of a chunk
const HIGH = 2 ** 32;

const TABLE = Uint32Array.from({ length: 256 }, (_, n) => { for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1; return n >>> 0; });

export function crc32(bytes, sum = 0) {
  sum = ~sum;
  for (let i = 0; i < bytes.length; i++) sum = TABLE[(sum ^ bytes[i]) & 255] ^ (sum >>> 8);
  return ~sum >>> 0;
}

const LEFT_OUT = -1, DEVICE = -2; // in place of a finger: ticks that were left out, and a message of the device

// What the host of a run wrote: tick, finger, place, buttons and number of each sample of a pointer, and each message of a device.
export class Samples {
  constructor() { this.rows = new Float64Array(7 * 1024); this.length = 0; this.late = false; }

  add(tick, finger, place, buttons, sample) {
    if (this.length === this.rows.length) { const more = new Float64Array(2 * this.rows.length); more.set(this.rows); this.rows = more; }
    this.rows.set([tick, finger, ...place, buttons, sample], this.length);
    this.length += 7;
  }

  skip(tick, count) { this.late = true; this.add(tick, LEFT_OUT, [count, 0, 0], 0, 0); }

  // A device runs by the real clock.
  sense(tick, sample) { this.late = true; this.add(tick, DEVICE, ...kept(sample)); }
}

// The file of a run of some ticks. about: description of the variant; module, parts: as for a Tick; done: takes the finished share.
export function record(about, module, parts, samples, ticks, done = () => {}) {
  const tick = new Tick(about, module, parts), { recording: head, pointers, devices } = about, file = new File(head, samples.late);
  const channels = new Map(head.channels.map(({ topic, id, keep }) => [topic, { id, keep }]));
  tick.listen(({ name }) => channels.get(name)?.keep ?? 0);
  const take = () => {
    for (const { stream, tick: at, time, bytes } of tick.messages()) file.message(channels.get(stream).id, at, time, bytes);
    tick.clear();
  };
  for (let at = 0; tick.tick < ticks && !tick.failed;) {
    for (; at < samples.length && samples.rows[at] === tick.tick; at += 7) {
      const [, finger, x, y, z, buttons, sample] = samples.rows.subarray(at, at + 7);
      if (finger === LEFT_OUT) tick.skip(x);
      else if (finger === DEVICE) tick.sense(0, restored([x, y, z], buttons, sample));
      else tick.point(finger, [x, y, z], buttons, sample);
    }
    if (tick.tick >= ticks) break; // the last ticks were left out
    const now = tick.tick, time = tick.time();
    tick.step(1, take);
    for (const host of [...pointers, ...devices]) file.message(channels.get(host.stream).id, now, time, tick.written(host));
    take();
    if (now % 1000 === 0) done(now / ticks);
  }
  return file.finish();
}

// Writes the records of an MCAP file in order.
class File {
  // late: whether ticks were left out, so that the rules of simulated time do not determine what each step used.
  constructor(head, late) {
    this.head = head; this.parts = []; this.at = 0; this.sum = 0; this.index = []; this.counts = new Map();
    this.chunk = new Bytes();
    this.write(MAGIC);
    this.write(new Bytes().text(head.profile).text(head.library).record(HEADER));
    for (const { name, metadata } of head.metadata) this.metadata(name, name === "palpate.about" ? { ...metadata, date: today(), ...(late ? { clock: JSON.stringify("real") } : {}) } : metadata);
    for (const record of this.declared()) this.chunk.raw(record);
    this.first = Infinity; this.last = 0;
  }

  *declared() {
    for (const { id, name, encoding, data } of this.head.schemas) yield new Bytes().u16(id).text(name).text(encoding).blob(new TextEncoder().encode(data)).record(SCHEMA);
    for (const { id, schema, topic, encoding, metadata } of this.head.channels) yield new Bytes().u16(id).u16(schema).text(topic).text(encoding).map(metadata).record(CHANNEL);
  }

  write(bytes) { this.parts.push(bytes); this.at += bytes.length; this.sum = crc32(bytes, this.sum); }

  message(channel, tick, time, payload) {
    this.chunk.message(channel, tick, time, payload);
    this.first = Math.min(this.first, time); this.last = Math.max(this.last, time);
    this.counts.set(channel, (this.counts.get(channel) ?? 0) + 1);
    if (this.chunk.length > ROOM) this.close();
  }

  close() {
    const data = this.chunk.taken();
    if (data.length) this.write(new Bytes().u64(Math.min(this.first, this.last)).u64(this.last).u64(data.length).u32(crc32(data)).text("").u64(data.length).raw(data).record(CHUNK));
    this.chunk = new Bytes();
  }

  metadata(name, data) {
    this.close();
    const { crc32: _, ...own } = data, bytes = new Bytes().text(name).map({ ...own, crc32: seal(name, own) }).record(METADATA);
    this.index.push({ at: this.at, length: bytes.length, name });
    this.write(bytes);
  }

  finish() {
    const counted = this.head.channels.map(({ id, topic }) => [topic, `{"count": ${this.counts.get(id) ?? 0}, "lost": 0}`]);
    this.metadata("palpate.page", { program: this.head.program });
    this.metadata("palpate.counts", Object.fromEntries(counted));
    this.metadata("palpate.times", {});
    this.write(new Bytes().u32(this.sum).record(DATA_END));
    const start = this.at, summary = new Bytes();
    for (const record of this.declared()) summary.raw(record);
    const total = [...this.counts.values()].reduce((a, b) => a + b, 0), each = new Bytes();
    for (const [channel, count] of this.counts) each.u16(channel).u64(count);
    summary.raw(new Bytes().u64(total).u16(this.head.schemas.length).u32(this.head.channels.length).u32(0).u32(this.index.length).u32(0)
      .u64(Math.min(this.first, this.last)).u64(this.last).blob(each.taken()).record(STATISTICS));
    for (const { at, length, name } of this.index) summary.raw(new Bytes().u64(at).u64(length).text(name).record(METADATA_INDEX));
    const body = summary.taken(), foot = new Bytes().u64(start).u64(0).u32(0).record(FOOTER).slice(0, -4);
    this.write(body); this.write(foot);
    this.write(new Bytes().u32(crc32(foot, crc32(body))).taken());
    this.write(MAGIC);
    return this.parts;
  }
}

// The checksum of metadata and their name, as `mcap_writer.seal`: of their JSON as Python writes it.
const ascii = (text) => JSON.stringify(text).replace(/[^ -~]/g, (c) => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`);
function seal(name, data) {
  const items = Object.entries(data).sort(([a], [b]) => (a < b ? -1 : 1)).map(([key, value]) => `[${ascii(key)}, ${ascii(value)}]`);
  return crc32(new TextEncoder().encode(`[${ascii(name)}, [${items.join(", ")}]]`)).toString(16).padStart(8, "0");
}

const today = () => JSON.stringify(`${new Date().toISOString().slice(0, 19)}+00:00`);

// Bytes that grow, little-endian.
class Bytes {
  constructor() { this.room = new Uint8Array(256); this.view = new DataView(this.room.buffer); this.length = 0; }

  grown(more) {
    const at = this.length;
    if (at + more > this.room.length) {
      const room = new Uint8Array(Math.max(2 * this.room.length, at + more));
      room.set(this.room); this.room = room; this.view = new DataView(room.buffer);
    }
    this.length += more;
    return at;
  }

  u8(value) { const at = this.grown(1); this.room[at] = value; return this; }
  u16(value) { const at = this.grown(2); this.view.setUint16(at, value, true); return this; }
  u32(value) { const at = this.grown(4); this.view.setUint32(at, value, true); return this; }
  u64(value) { return this.u32(value % HIGH).u32(Math.floor(value / HIGH)); }
  raw(bytes) { const at = this.grown(bytes.length); this.room.set(bytes, at); return this; }
  blob(bytes) { return this.u32(bytes.length).raw(bytes); }
  text(text) { return this.blob(new TextEncoder().encode(text)); }
  map(entries) {
    const inside = new Bytes();
    for (const [key, value] of Object.entries(entries)) inside.text(key).text(value);
    return this.blob(inside.taken());
  }
  message(channel, tick, time, payload) { this.u8(MESSAGE).u64(22 + payload.length).u16(channel).u32(tick).u64(time).u64(time).raw(payload); }
  taken() { return this.room.slice(0, this.length); }
  record(kind) { return new Bytes().u8(kind).u64(this.length).raw(this.taken()).taken(); }
}
