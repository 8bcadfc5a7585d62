"""Compiled decoder from the wire format to records, driven by the plan of the encoder (`wire_plan`).

It reads the form in which `encode` and `messages.pack` write a message. Any other form is *unusual*: the caller leaves
it to msgspec, which accepts every msgpack form of the message, or rejects it. The bytes are untrusted: each length is
compared with the end of the message before a byte is read.
"""

from typing import Any

import numpy as np
from numba import types

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import big, copy, pointer, set_word, word
from palpate.engine.encode import STEP_SIZE, byte, flag, step_at
from palpate.engine.wire_plan import ARRAY, DELAYED, FLAG, FLOATS, INTEGER, MAP, USED, VECTOR, WORD
from palpate.messages.record import HEAD, ROOM

memcmp: Any = types.ExternalFunction("memcmp", types.int32(types.int64, types.int64, types.int64))
FORM = np.dtype([(n, "<i8") for n in ("steps", "count", "literals", "axes", "lengths", "letters", "blank")])
"""Form of the messages of one stream.

steps, count, literals, axes, letters  of a `WirePlan`, by address
lengths  address of memory for `letters` numbers
blank    address of a record without a message, which has the shapes of empty arrays
"""
form_at, head_at = pointer(FORM), pointer(np.dtype(HEAD, align=True))
LARGEST = 1 << 30  # [bytes] above the length of any message, so that products of two lengths do not overflow
USED_MOST = 62  # inputs of a message in the bit mask of a record


@kernel
def integer(at, end):
    """A msgpack integer: its value and the address after it; address 0: something else, or cut off."""
    if at >= end:
        return np.int64(0), np.int64(0)
    code = np.int64(byte(at).value)
    if code < 0x80:
        return code, at + 1
    if code >= 0xE0:
        return code - 256, at + 1
    if code < 0xCC or code > 0xD3:
        return np.int64(0), np.int64(0)
    size = np.int64(1) << ((code - 0xCC) & 3)
    if end - at < 1 + size:
        return np.int64(0), np.int64(0)
    value = np.int64(0)
    for i in range(size):
        value = (value << 8) | np.int64(byte(at + 1 + i).value)
    if code >= 0xD0 and size < 8 and value >> (8 * size - 1):
        value -= np.int64(1) << (8 * size)
    if code == 0xCF and value < 0:  # 2^63 or more
        return np.int64(0), np.int64(0)
    return value, at + 1 + size


@kernel
def entries(at, end, short, long):
    """Number of entries of a map or an array, and the address after its header; address 0: something else."""
    if at >= end:
        return np.int64(0), np.int64(0)
    code = np.int64(byte(at).value)
    if code & 0xF0 == short:
        return code & 15, at + 1
    if code == long and end - at >= 3:
        return (np.int64(byte(at + 1).value) << 8) | np.int64(byte(at + 2).value), at + 3
    return np.int64(0), np.int64(0)


@kernel
def _floats(to, at, end, count):
    """Read `count` floats; the address after them, or 0."""
    if end - at < 9 * count:
        return np.int64(0)
    for i in range(count):
        if byte(at).value != 0xCB:
            return np.int64(0)
        set_word(to + 8 * i, big(at + 1))
        at += 9
    return at


@kernel
def _word(step, literals, to, at, end):
    """Read a word as its index; the address after it, or 0."""
    for i in range(step.count):
        entry = literals + step.more + 32 * i
        size = np.int64(byte(entry).value)
        if end - at >= size and memcmp(at, entry + 1, size) == 0:
            set_word(to, i)
            return at + size
    return np.int64(0)


@kernel
def _shape(form, step, to, at, end):
    """Read the shape of an array: size [bytes] and the address after the shape, or 0."""
    count, at = entries(at, end, 0x90, 0xDC)
    size = step.size
    if at == 0 or count != step.count:
        return size, np.int64(0)
    for i in range(step.count):
        length, at = integer(at, end)
        if at == 0 or length < 0 or length > LARGEST:
            return size, np.int64(0)
        want = word(form.axes + 8 * (step.axes + i))
        if want < 0:
            known = form.lengths - 8 * (want + 1)
            if word(known) < 0:
                set_word(known, length)
            want = word(known)
        if length != want:
            return size, np.int64(0)
        set_word(to + 8 + 8 * i, length)
        size *= length
        if size > LARGEST:
            return size, np.int64(0)
    return size, at


@kernel
def _array(form, step, to, at, end, arena, room):
    """Read an array and copy its bytes to the arena: the addresses after it in the message, or 0, and in the arena."""
    size, at = _shape(form, step, to, at, end)
    if at == 0 or end - at < 7 or byte(at).value != 0xA4:
        return np.int64(0), arena
    if byte(at + 1).value != 0x64 or byte(at + 2).value != 0x61 or byte(at + 3).value != 0x74:
        return np.int64(0), arena
    code = np.int64(byte(at + 5).value)
    if byte(at + 4).value != 0x61 or code < 0xC4 or code > 0xC6:  # "data"
        return np.int64(0), arena
    count, at = np.int64(1) << (code - 0xC4), at + 6
    if end - at < count:
        return np.int64(0), arena
    length = np.int64(0)
    for i in range(count):
        length = (length << 8) | np.int64(byte(at + i).value)
    at += count
    if length != size or end - at < size or room < size + 8:
        return np.int64(0), arena
    copy(arena, at, size)
    set_word(to, arena)
    return at + size, arena + ((size + 7) & ~7)


@kernel
def _absent(form, step, to):
    """Whether the shape of an array fits that was omitted because it is empty."""
    empty = form.blank + step.at
    set_word(to, 0)
    for i in range(step.count):
        length, want = word(empty + 8 + 8 * i), word(form.axes + 8 * (step.axes + i))
        if want < 0:
            known = form.lengths - 8 * (want + 1)
            if word(known) < 0:
                set_word(known, length)
            if word(known) != length:
                return False
        set_word(to + 8 + 8 * i, length)
    return True


@kernel
def _read_used(head, at, end):
    """Read the ticks of the inputs as the mask of the available ones; the address after them, or 0."""
    count, at = entries(at, end, 0x90, 0xDC)
    present = np.int64(0)
    if at == 0 or count > USED_MOST:
        return np.int64(0)
    for i in range(count):
        tick, at = integer(at, end)
        if at == 0:
            return np.int64(0)
        if tick >= 0:
            present |= np.int64(1) << i
    head.present = present
    return at


@kernel
def _value(form, step, to, at, end):
    """Read a value that is not an array; the address after it, or 0."""
    if step.kind == FLOATS:
        return _floats(to, at, end, step.count)
    if step.kind == INTEGER or step.kind == DELAYED:
        for i in range(step.count):
            number, at = integer(at, end)
            if at == 0:
                return np.int64(0)
            set_word(to + 8 * i, number)
        return at
    if step.kind == FLAG:
        if at >= end or (byte(at).value != 0xC3 and byte(at).value != 0xC2):
            return np.int64(0)
        flag(to).value = byte(at).value == 0xC3
        return at + 1
    if step.kind == VECTOR:
        count, at = entries(at, end, 0x90, 0xDC)
        if at == 0 or count > ROOM:
            return np.int64(0)
        set_word(to, count)
        return _floats(to + 8, at, end, count)
    if step.kind == WORD:
        return _word(step, form.literals, to, at, end)
    return at  # the source, which is a literal


@kernel
def decode(form_address, record, at, end, arena, room):
    """Read a message in the form of `encode` at [at, end) into a record.

    False: another form; the record is then undefined.

    form_address  address of the `FORM`
    arena, room   address and size of the memory to which arrays are copied
    """
    form, head, limit = form_at(form_address), head_at(record), arena + room
    count = found = np.int64(0)
    for i in range(form.letters):
        set_word(form.lengths + 8 * i, -1)
    for k in range(form.count):
        step = step_at(form.steps + k * STEP_SIZE)
        to = record + step.at
        if step.kind == MAP:
            count, at = entries(at, end, 0x80, 0xDE)
            if at == 0:
                return False
            continue
        if end - at < step.length or memcmp(at, form.literals + step.first, step.length) != 0:
            if step.kind == ARRAY and step.more == 1 and _absent(form, step, to):
                continue
            if step.kind == DELAYED:  # omitted: the sample is not late
                set_word(to, 0)
                continue
            return False
        at += step.length
        found += 1
        if step.kind == ARRAY:
            at, arena = _array(form, step, to, at, end, arena, limit - arena)
        elif step.kind == USED:
            at = _read_used(head, at, end)
        else:
            at = _value(form, step, to, at, end)
        if at == 0:
            return False
    head.there = True
    return at == end and found == count
