// Files of a folder of `palpate build web`: scripts that call `palpateData(hash, text)`, with compressed bytes as text.

import { sha256 } from "/sha256.js";
import { restored } from "/unpack.js";

const KEY = 32; // [bytes] of the hash of data

// The data in a file by their hashes, as `joined` in web/packing.py; its compressed bytes must have the hash in its name.
export async function unpacked(hash, text) {
  const letters = atob(text), packed = new Uint8Array(letters.length);
  for (let k = 0; k < packed.length; k++) packed[k] = letters.charCodeAt(k);
  if (sha256(packed) !== hash) throw new Error("it does not have the hash in its name");
  const { readable, writable } = new DecompressionStream("gzip"), writer = writable.getWriter();
  for (const done of [writer.write(packed), writer.close()]) done.catch(() => {}); // reading fails too
  return parted(new Uint8Array(await new Response(readable).arrayBuffer()));
}

function parted(bytes) {
  const view = new DataView(bytes.buffer), count = view.getUint32(0, true), found = new Map();
  for (let k = 0, head = 4, at = 4 + (KEY + 4) * count; k < count; k++, head += KEY + 4) {
    const key = Array.from(bytes.subarray(head, head + KEY), (byte) => byte.toString(16).padStart(2, "0")).join("");
    const end = at + view.getUint32(head + KEY, true);
    found.set(key, restored(bytes.slice(at, end)));
    at = end;
  }
  return found;
}

// The text in a script of data.
export function quoted(script) {
  const found = /^palpateData\("([0-9a-f]{64})", "([\w+/=]*)"\);\s*$/.exec(script);
  if (!found) throw new Error("it is no file of data");
  return found[2];
}
