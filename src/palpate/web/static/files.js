// Files of a folder of `palpate build web`: scripts that call `palpateData(hash, text)`, with compressed bytes as text.

import { sha256 } from "/sha256.js";

// The bytes of a file, which must have the hash in its name.
export async function unpacked(hash, text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  if (sha256(bytes) !== hash) throw new Error("it does not have the hash in its name");
  return bytes;
}

// The text in a script of data.
export function quoted(script) {
  const found = /^palpateData\("([0-9a-f]{64})", "([\w+/=]*)"\);\s*$/.exec(script);
  if (!found) throw new Error("it is no file of data");
  return found[2];
}
