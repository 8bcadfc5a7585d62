// Runs the kernel `calculate` of test_wasm.py; prints how much of its heap it has used.

import fs from "fs";

const AT = 1 << 20, TO = 1 << 22, HEAP = 1 << 23;
const memory = new WebAssembly.Memory({ initial: 256 }), given = fs.readFileSync("given");
const env = {
  __linear_memory: memory, __stack_pointer: new WebAssembly.Global({ value: "i32", mutable: true }, AT - 64),
  __indirect_function_table: new WebAssembly.Table({ initial: 16, element: "anyfunc" }),
};
const { exports } = new WebAssembly.Instance(new WebAssembly.Module(fs.readFileSync("code.wasm")), { env });
new Uint8Array(memory.buffer).set(given, AT);
exports.place_heap(HEAP, 2 * HEAP);
exports.calculate(AT, given.length / 24, TO);
fs.writeFileSync("found", new Uint8Array(memory.buffer, TO, given.length));
console.log(JSON.stringify(exports.heap_top() - HEAP));
