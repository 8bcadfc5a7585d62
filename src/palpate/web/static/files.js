// Files of a folder of `palpate build web`: scripts that call `palpateData(hash, text)`, with compressed bytes as text.

import { sha256 } from "/sha256.js";
import { restored } from "/unpack.js";

// The content of a file, whose compressed bytes must have the hash in its name.
export async function unpacked(hash, text) {
  const letters = atob(text), packed = new Uint8Array(letters.length);
  for (let k = 0; k < packed.length; k++) packed[k] = letters.charCodeAt(k);
  if (sha256(packed) !== hash) throw new Error("it does not have the hash in its name");
  const { readable, writable } = new DecompressionStream("gzip"), writer = writable.getWriter();
  for (const done of [writer.write(packed), writer.close()]) done.catch(() => {}); // reading fails too
  return restored(new Uint8Array(await new Response(readable).arrayBuffer()));
}

// The text in a script of data.
export function quoted(script) {
  const found = /^palpateData\("([0-9a-f]{64})", "([\w+/=]*)"\);\s*$/.exec(script);
  if (!found) throw new Error("it is no file of data");
  return found[2];
}
