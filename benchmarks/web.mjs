// Ticks of a program in Node: processor time of each turn, and digests of all streams if wanted. For benchmarks/web.py.

import crypto from "crypto";
import fs from "fs";
import { Tick } from "./tick.mjs";

const [ticks, turns, hashes] = process.argv.slice(2).map(Number), about = JSON.parse(fs.readFileSync("about.json"));
const parts = new Map(about.parts.map(({ hash }) => [hash, new Uint8Array(fs.readFileSync(hash))]));
const tick = new Tick(about, new WebAssembly.Module(fs.readFileSync("tick.wasm")), parts), seconds = [], sums = {};

function take() {
  for (const { stream, bytes } of tick.messages()) (sums[stream] ??= crypto.createHash("sha256")).update(bytes);
  tick.clear();
}

for (let turn = 0; turn < turns; turn++) {
  tick.begin();
  tick.listen(() => hashes);
  const before = process.cpuUsage();
  for (let k = 0; k < ticks && !tick.failed; k += 100) { tick.step(Math.min(100, ticks - k), take); take(); }
  const { user, system } = process.cpuUsage(before);
  seconds.push((user + system) * 1e-6);
}
for (const name in sums) sums[name] = sums[name].digest("hex");
const heap = tick.code.heap_top() - about.size, memory = tick.memory.buffer.byteLength, resident = process.memoryUsage().rss;
console.log(JSON.stringify({ seconds, sums, heap, memory, failed: tick.failed, resident }));
