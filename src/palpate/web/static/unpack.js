// Restores memory from the forms of web/packing.py. A form begins with a head of eight bytes, of which the first is its kind.

const HEAD = 8, APART = 3; // as there

export function restored(form) {
  const [kind, width, back] = form, body = form.slice(HEAD);
  if (kind === 0) return body;
  if (kind === 1) return summed(body, width, back);
  const head = new DataView(form.buffer, form.byteOffset);
  const size = head.getUint16(2, true), step = head.getFloat32(4, true);
  return kind === 2 ? mirrored(body, size, step) : multiplied(body, width, size, step);
}

// Words whose differences to the word `back` words before them are given, the lowest bytes of all words first.
function summed(body, width, back) {
  const count = Math.floor(body.length / width), bytes = new Uint8Array(body.length);
  for (let byte = 0; byte < width; byte++) for (let k = 0, from = byte * count; k < count; k++) bytes[width * k + byte] = body[from + k];
  bytes.set(body.subarray(count * width), count * width);
  if (!back) return bytes;
  const words = new Uint32Array(bytes.buffer, 0, (count * width) / 4);
  if (width === 4) { for (let k = back; k < count; k++) words[k] += words[k - back]; return bytes; }
  for (let k = 2 * back; k < words.length; k += 2) {
    const earlier = words[k - 2 * back], low = words[k] + earlier;
    words[k + 1] += words[k + 1 - 2 * back] + (low > 0xffffffff);
    words[k] = low;
  }
  return bytes;
}

// A symmetric matrix of multiples of a step, of whose lower half the second differences are given.
function mirrored(body, size, step) {
  const count = body.length / 2, all = new Int16Array(size * size), numbers = new Float32Array(size * size);
  for (let i = 0, at = 0; i < size; i++) {
    const row = i * size, above = row - APART * size;
    for (let j = 0; j <= i; j++, at++) {
      let value = body[at] + 256 * body[count + at];
      if (i >= APART) value += all[above + j];
      if (j >= APART) { value += all[row + j - APART]; if (i >= APART) value -= all[above + j - APART]; }
      all[row + j] = all[j * size + i] = value;
    }
  }
  for (let k = 0; k < all.length; k++) numbers[k] = all[k] * step;
  return new Uint8Array(numbers.buffer);
}

// Numbers of half precision times a step; if there is a size, the lower half of a symmetric matrix of so many rows.
function multiplied(body, width, size, step) {
  const count = body.length / 2, length = size ? size * size : count;
  const numbers = width === 4 ? new Float32Array(length) : new Float64Array(length);
  const number = (at) => Math.fround(half(body[at] + 256 * body[count + at]) * step);
  if (!size) for (let at = 0; at < count; at++) numbers[at] = number(at);
  for (let i = 0, at = 0; i < size; i++) {
    for (let j = 0; j <= i; j++, at++) numbers[i * size + j] = numbers[j * size + i] = number(at);
  }
  return new Uint8Array(numbers.buffer);
}

// The finite number of half precision with these bits.
function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  return sign * (exponent ? (1024 + part) * 2 ** (exponent - 25) : part * 2 ** -24);
}
