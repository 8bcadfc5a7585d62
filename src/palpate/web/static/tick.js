// The compiled tick of a graph: its memory, its messages, and steps of a fixed size. For the page, its worker, and programs.

const STACK = (1 << 20) - 64; // [bytes] where the stack begins, which grows down; the arrays of the run begin after it
const ENTRY = 40; // [bytes] of an entry of the journal: number, tick, time, begin and end, eight bytes each
const HEAP = 1 << 24; // [bytes] for arrays that kernels make while they run
const DELAYED = 32; // [bytes] place of the age of a message in its record (messages/record.py)
const HIGH = 2 ** 32;

export class Tick {
  // about: description of a variant (`site.variants`); module: a WebAssembly.Module; parts: its memory, Uint8Arrays by their hash.
  constructor(about, module, parts) {
    this.about = about;
    const size = about.size + HEAP, pages = Math.ceil(size / 65536);
    this.memory = new WebAssembly.Memory({ initial: pages, maximum: pages });
    const table = new WebAssembly.Table({ initial: about.table, element: "anyfunc" });
    const pointer = new WebAssembly.Global({ value: "i32", mutable: true }, STACK);
    const env = { __linear_memory: this.memory, __indirect_function_table: table, __stack_pointer: pointer };
    this.code = new WebAssembly.Instance(module, { env }).exports;
    this.bytes = new Uint8Array(this.memory.buffer);
    this.view = new DataView(this.memory.buffer);
    this.parts = parts;
    this.streams = new Map(about.streams.map((stream) => [stream.name, stream]));
    this.begin();
  }

  // Set the memory to that of the start.
  begin() {
    this.bytes.fill(0, STACK + 64, this.about.size);
    for (const { at, hash } of this.about.parts) this.bytes.set(this.parts.get(hash), at);
    const heap = Math.ceil(this.about.size / 64) * 64;
    this.code.place_heap(heap, heap + HEAP);
    this.tick = 0;
    this.failed = null;
    this.about.pointers.forEach(({ begin }, finger) => this.point(finger, begin, 0, 0));
    this.about.devices.forEach((_, number) => this.sense(number, { joints: [], position: [], buttons: 0, homed: false, age: 0 }));
  }

  // Set the target of a finger: place [m, world], bit mask of the pressed buttons, number of the sample.
  point(finger, place, buttons, sample) {
    for (const record of this.about.pointers[finger].records) {
      const { position, buttons: pressed, sample: number } = this.about.pointers[finger].fields;
      for (let i = 0; i < 3; i++) this.view.setFloat64(record + position.at + 8 * i, place[i], true);
      this.setInteger(record + pressed.at, buttons);
      this.setInteger(record + number.at, sample);
    }
  }

  // Set the message of a device: angles [rad], position [m], pressed buttons, whether it is homed, and its age [ns].
  sense(number, { joints, position, buttons, homed, age }) {
    const { records, fields } = this.about.devices[number], lists = [[fields.joints, joints], [fields.position, position]];
    for (const record of records) {
      for (const [{ at }, values] of lists) {
        this.setInteger(record + at, values.length);
        values.forEach((x, i) => this.view.setFloat64(record + at + 8 + 8 * i, x, true));
      }
      this.setInteger(record + fields.buttons.at, buttons);
      this.bytes[record + fields.homed.at] = Number(homed);
      this.setInteger(record + DELAYED, age);
    }
  }

  // Run ticks. Returns how many ran: fewer if a node failed (`failed`). `taken` is called where the journal is full, and must empty it.
  step(count, taken = () => this.clear()) {
    const { run: [rows, clock], clock: at, pointers, devices } = this.about, hosts = [...pointers, ...devices], block = hosts.length ? 1 : count;
    if (this.failed) return 0;
    let left = count;
    while (left > 0) {
      const ticks = Math.min(block, left);
      for (const { records } of hosts) for (const record of records) this.stamp(record);
      let next = this.tick;
      for (const end = this.tick + ticks; next < end;) {
        this.code.run(rows, clock, next, end - next);
        if (this.integer(at.failed) >= 0) { this.fail(); return count - left; }
        if (this.integer(at.resume) < 0) break;
        next = this.integer(at.tick);
        taken(this);
        if (this.integer(at.entries)) throw new Error("the journal was not emptied");
      }
      this.tick += ticks;
      left -= ticks;
    }
    return count;
  }

  // Leave ticks out, as a run on the real clock does when it is late: the next step is longer, which the nodes take for a pause,
  // and the force ramps up from zero.
  skip(count) { this.tick += count; }

  // Header of a message of the host of the next tick.
  stamp(record) {
    this.bytes[record] = 1;
    this.setInteger(record + 8, this.tick);
    this.setInteger(record + 16, this.time());
  }

  // [ns] of the next tick.
  time() {
    const exact = (this.tick * 1e9) / this.about.rate, near = Math.round(exact);
    return near - exact === 0.5 && near % 2 ? near - 1 : near; // half to even
  }

  fail() {
    const { clock, nodes, why } = this.about;
    this.failed = { node: nodes[this.integer(clock.failed)], why: why[this.integer(clock.why)] ?? "it failed", tick: this.integer(clock.tick) };
  }

  // Which messages the journal takes: of each stream those of every n-th tick, 0 none.
  listen(of) { for (const stream of this.about.streams) this.setInteger(stream.period, of(stream)); }

  // The encoded messages since the journal was last emptied: stream, tick, time [ns] and bytes, which are overwritten later.
  *messages() {
    const { clock, journal, entry, streams } = this.about;
    for (let k = 0, at = entry; k < this.integer(clock.entries); k++, at += ENTRY) {
      const [number, tick, time, begin, end] = [0, 8, 16, 24, 32].map((word) => this.integer(at + word));
      yield { stream: streams[number].name, tick, time, bytes: this.bytes.subarray(journal + begin, journal + end) };
    }
  }

  clear() { this.setInteger(this.about.clock.entries, 0); this.setInteger(this.about.clock.length, 0); }

  // The encoded message of a pointer or device at the last tick.
  written({ records: [record], steps, count, literals, buffer }) {
    return this.bytes.subarray(buffer, this.code.encode(steps, count, literals, record, 0, 0, buffer));
  }

  // Number of the newest sample of a pointer.
  sample(stream) {
    const { records: [record], fields } = this.about.pointers.find((pointer) => pointer.stream === stream);
    return this.integer(record + fields.sample.at);
  }

  // Whether a stream has a message.
  has(name) { return this.bytes[this.streams.get(name).record] === 1; }

  // [s] time of the newest message of a stream.
  when(name) { return this.integer(this.streams.get(name).record + 16) * 1e-9; }

  // A field of the newest message of a stream: a number, a flag, a word, a list, or a typed array that shows the memory as it is now.
  read(name, field) {
    const { record, fields } = this.streams.get(name), form = fields[field], at = record + form.at;
    switch (form.form) {
      case "number": return this.view.getFloat64(at, true);
      case "integer": return this.integer(at);
      case "flag": return this.bytes[at] === 1;
      case "word": return form.words[this.integer(at)];
      case "vector": return [...new Float64Array(this.memory.buffer, at, form.count)];
      case "integers": return Array.from({ length: form.count }, (_, i) => this.integer(at + 8 * i));
      case "list": return [...new Float64Array(this.memory.buffer, at + 8, this.integer(at))];
      default: {
        const shape = Array.from({ length: form.axes }, (_, i) => this.integer(at + 8 + 8 * i)), count = shape.reduce((a, b) => a * b, 1);
        return new (form.form === "reals" ? Float64Array : Int32Array)(this.memory.buffer, count ? this.integer(at) : 0, count);
      }
    }
  }

  // Lengths of the axes of a field that is an array.
  shape(name, field) {
    const { record, fields } = this.streams.get(name), { at, axes } = fields[field];
    return Array.from({ length: axes }, (_, i) => this.integer(record + at + 8 + 8 * i));
  }

  // A 64-bit integer of at most 53 bits.
  integer(at) { return this.view.getUint32(at, true) + HIGH * this.view.getInt32(at + 4, true); }

  setInteger(at, value) { this.view.setUint32(at, value % HIGH, true); this.view.setInt32(at + 4, Math.floor(value / HIGH), true); }
}
