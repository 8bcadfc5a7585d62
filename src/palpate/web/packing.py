"""Makes memory short before it is compressed, so that the page restores the same bytes (`static/unpack.js`).

Arrays of floating-point numbers and of indices compress better as differences to an earlier word, with the bytes of
equal significance together. A compliance matrix is symmetric and consists of multiples of a step
(`physics.bodies.condensed_basis`), which are smooth along the surface: half of it as second differences of 16 bits
takes 20 % of the bytes. A sampled basis consists of numbers of half precision times a step
(`physics.bodies.sampled_body`); of a symmetric matrix of these the lower half is kept. Each form begins with a head of
`HEAD` bytes: its kind, then as the kind needs.
"""

import math
import struct
import zlib
from collections.abc import Mapping

import numpy as np

HEAD = 8
PLAIN, DIFFERENCES, SYMMETRIC, HALVES = range(4)
FORMS = [(4, 0), (4, 1), (4, 3), (4, 8), (8, 0), (8, 1), (8, 3), (8, 6), (8, 7), (8, 8)]
"""Bytes of a word, and number of words to the earlier one (0: the words themselves) that are tried: indices, vectors,
and records of 32 to 64 bytes."""
SAMPLE = 1 << 17  # [bytes] with which a form is chosen
MOST = 32767  # the largest multiple of a step
LARGEST = np.float32(3e4)  # the largest number of half precision
APART = 3  # [1] entries from a vertex to the next one


def shortest(data: bytes) -> bytes:
    """The form of memory that is the shortest one when compressed."""
    matrix = symmetric(data) if len(data) >= SAMPLE else None
    if matrix is not None:
        return matrix
    half = halves(data) if len(data) >= SAMPLE else None
    forms = [*_forms(data), *([half] if half is not None else [])]
    return min(forms, key=lambda form: len(squeezed(form))) if len(forms) > 1 else forms[0]


def squeezed(data: bytes) -> bytes:
    """Bytes compressed with gzip."""
    squeeze = zlib.compressobj(9, zlib.DEFLATED, 31)
    return squeeze.compress(data) + squeeze.flush()


def joined(forms: Mapping[bytes, bytes]) -> bytes:
    """The content of a file: the number of forms, for each the SHA-256 of its memory and its length, then the forms.

    forms  by the SHA-256 of their memory
    """
    heads = (key + struct.pack("<I", len(form)) for key, form in forms.items())
    return struct.pack("<I", len(forms)) + b"".join(heads) + b"".join(forms.values())


def _forms(data: bytes) -> list[bytes]:
    """The plain form, and of the others that which makes a part of the memory shortest."""
    plain = bytes([PLAIN]).ljust(HEAD, b"\0") + data
    middle = max(0, len(data) - SAMPLE) // 16 * 8
    part = data[middle : middle + SAMPLE]
    sizes = {form: len(zlib.compress(differences(part, *form), 6)) for form in FORMS}
    best = min(sizes, key=lambda form: sizes[form])
    return [differences(data, *best)] if sizes[best] < len(zlib.compress(part, 6)) else [plain]


def differences(data: bytes, width: int, back: int) -> bytes:
    """Each word less the one that lies `back` words before it (0: the word itself), modulo its range, the lowest bytes
    of all words first; then the bytes after the last whole word."""
    count = len(data) // width
    words = np.frombuffer(data[: count * width], f"<u{width}").copy()
    if back:
        words[back:] -= np.frombuffer(data, f"<u{width}", count - min(back, count))
    planes = words.view(np.uint8).reshape(-1, width).T.tobytes()
    return bytes([DIFFERENCES, width, back]).ljust(HEAD, b"\0") + planes + data[count * width :]


def symmetric(data: bytes) -> bytes | None:
    """A symmetric matrix (n,n) of float32 that are multiples of the largest one over `MOST`: n, the step, and the lower
    half of the multiples as second differences along both axes, low bytes first. None: another content."""
    size = math.isqrt(len(data) // 4)
    if 4 * size * size != len(data) or size <= APART:
        return None
    matrix = np.frombuffer(data, "<f4").reshape(size, size)
    if not np.isfinite(matrix).all() or not (largest := np.abs(matrix).max()) > 0.0:
        return None
    step = largest / np.float32(MOST)
    multiples = np.rint(matrix / step).astype("<i2")
    if (multiples * step).tobytes() != data or not np.array_equal(matrix, matrix.T):
        return None
    words = multiples.view("<u2").copy()
    words[APART:] -= multiples.view("<u2")[:-APART]
    rows = words.copy()
    words[:, APART:] -= rows[:, :-APART]
    lower = words[np.tril_indices(size)]
    head = struct.pack("<BxHf", SYMMETRIC, size, step)
    return head + lower.view(np.uint8).reshape(-1, 2).T.tobytes()


def halves(data: bytes) -> bytes | None:
    """Numbers of half precision times a step, as float32 or float64: bytes of a number, rows of a symmetric matrix or
    0, the step, and the numbers of half precision, low bytes first; of a symmetric matrix the lower half. None: another
    content."""
    for width in (4, 8):
        numbers = np.frombuffer(data, f"<f{width}", len(data) // width)
        with np.errstate(all="ignore"):
            single = numbers.astype("<f4")
            found = _halves(single) if single.astype(numbers.dtype).tobytes() == data else None
        if found is not None:
            step, words = found
            size = math.isqrt(len(words))
            matrix = words[: size * size].reshape(size, size)
            mirrored = (
                size * size == len(words)
                and size < 1 << 16
                and np.array_equal(matrix.view("<u2"), matrix.T.view("<u2"))
            )
            head = struct.pack("<BBHf", HALVES, width, size if mirrored else 0, step)
            kept = matrix[np.tril_indices(size)] if mirrored else words
            return head + kept.view(np.uint8).reshape(-1, 2).T.tobytes()
    return None


def _halves(numbers: np.ndarray) -> tuple[np.float32, np.ndarray] | None:
    """The step and the numbers of half precision whose products are these float32."""
    largest = np.abs(numbers).max(initial=0.0)
    if not 0.0 < largest < np.inf:
        return None
    near = largest / LARGEST
    for step in (near, np.nextafter(near, np.float32(0.0)), np.nextafter(near, largest)):
        words = (numbers / step).astype("<f2")
        if (words * step).tobytes() == numbers.tobytes():
            return step, words
    return None
