// Digests of all streams of a program, for in_node.py.

import crypto from "crypto";
import fs from "fs";
import { Tick } from "./tick.mjs";

const about = JSON.parse(fs.readFileSync("about.json")), ticks = Number(process.argv[2]), sums = new Map();
const parts = new Map(about.parts.map(({ hash }) => [hash, new Uint8Array(fs.readFileSync(hash))]));
const tick = new Tick(about, new WebAssembly.Module(fs.readFileSync("tick.wasm")), parts);

function take() {
  for (const { stream, bytes } of tick.messages()) {
    if (!sums.has(stream)) sums.set(stream, crypto.createHash("sha256"));
    sums.get(stream).update(bytes);
  }
  tick.clear();
}

tick.listen(() => 1);
for (let k = 0; k < ticks && !tick.failed; k += 100) { tick.step(Math.min(100, ticks - k), take); take(); }
const digests = Object.fromEntries([...sums].map(([name, sum]) => [name, sum.digest("hex").slice(0, 16)]));
console.log(JSON.stringify({ failed: tick.failed, heap: tick.code.heap_top() - about.size, digests }));
