"""Compiled encoder from records to the wire format, driven by a plan (`wire_plan`); same bytes as `messages.pack`."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import big, copy, pointer, set_big, word
from palpate.engine.wire_plan import ARRAY, DELAYED, FLAG, FLOATS, INTEGER, MAP, STEP, USED, VECTOR, WORD

step_at, STEP_SIZE = pointer(STEP), STEP.itemsize
byte = pointer(np.dtype([("value", "u1")]))
flag = pointer(np.dtype([("value", "?")]))


@kernel
def _put(at, value):
    byte(at).value = value
    return at + 1


@kernel
def _big(at, value, count):
    """Write an integer of `count` bytes, big-endian, and up to 7 bytes more, which the next value overwrites."""
    set_big(at, value << (64 - 8 * count))
    return at + count


@kernel
def _literal(at, source, count):
    """Copy bytes, and up to 7 more (`SLACK`), which the next value overwrites: faster than a call of `memcpy`."""
    for i in range(0, count, 8):
        set_big(at + i, big(source + i))
    return at + count


@kernel
def _integer(at, value):
    """Write an integer in its shortest msgpack form."""
    if -32 <= value < 0x80:
        return _put(at, value & 0xFF)
    code, half = (0xCC, value >> 1) if value >= 0 else (0xD0, ~value)
    form = (half >= 0x80) + (half >= 0x8000) + (half >= 0x80000000)  # of 1, 2, 4 or 8 bytes
    return _big(_put(at, code + form), value, 1 << form)


@kernel
def _header(at, count, short, long):
    """Write the header of a map or an array with `count` entries."""
    return _put(at, short | count) if count < 16 else _big(_put(at, long), count, 2)


@kernel
def _floats(at, source, count):
    for i in range(count):
        at = set_big(_put(at, 0xCB), word(source + 8 * i))
    return at


@kernel
def _array(at, handle, axes, size):
    """Write the shape and the bytes of an array."""
    at, count = _header(at, axes, 0x90, 0xDC), size
    for i in range(axes):
        length = word(handle + 8 + 8 * i)
        at, count = _integer(at, length), count * length
    at = _put(at, 0xA4)
    for letter in (0x64, 0x61, 0x74, 0x61):  # "data"
        at = _put(at, letter)
    form = (count >= 0x100) + (count >= 0x10000)  # a length of 1, 2 or 4 bytes
    at = _big(_put(at, 0xC4 + form), count, 1 << form)
    return copy(at, word(handle), count)


@kernel
def _empty(handle, axes):
    size = 1
    for i in range(axes):
        size *= word(handle + 8 + 8 * i)
    return size == 0


@kernel
def encoded_size(steps, count, record, most):
    """Upper bound [bytes] of an encoded message with its arrays."""
    for k in range(count):
        step = step_at(steps + k * STEP_SIZE)
        if step.kind == ARRAY:
            size = step.size
            for i in range(step.count):
                size *= word(record + step.at + 8 + 8 * i)
            most += size
    return most


@kernel
def encode(steps, count, literals, record, used, inputs, at):
    """Write a message to the address `at`. Returns the address after it; up to `SLACK` bytes behind it are changed.

    steps, count, literals  address and number of the steps of a `WirePlan`, address of its literal bytes
    record                  address of the message
    used, inputs            address and number of the ticks of its inputs
    """
    for k in range(count):
        step = step_at(steps + k * STEP_SIZE)
        value = record + step.at
        if step.kind == MAP:
            entries = step.count
            for j in range(count):
                other = step_at(steps + j * STEP_SIZE)
                if other.kind == ARRAY and other.more == 1 and not _empty(record + other.at, other.count):
                    entries += 1
                if other.kind == DELAYED and word(record + other.at) != 0:
                    entries += 1
            at = _header(at, entries, 0x80, 0xDE)
            continue
        if step.kind == ARRAY and step.more == 1 and _empty(value, step.count):
            continue
        if step.kind == DELAYED and word(value) == 0:
            continue
        at = _literal(at, literals + step.first, step.length)
        if step.kind == FLOATS:
            at = _floats(at, value, step.count)
        elif step.kind == INTEGER or step.kind == DELAYED:
            for i in range(step.count):
                at = _integer(at, word(value + 8 * i))
        elif step.kind == FLAG:
            at = _put(at, 0xC3 if flag(value).value else 0xC2)
        elif step.kind == VECTOR:
            at = _header(at, word(value), 0x90, 0xDC)
            at = _floats(at, value + 8, word(value))
        elif step.kind == ARRAY:
            at = _array(at, value, step.count, step.size)
        elif step.kind == WORD:
            entry = literals + step.more + 32 * word(value)
            at = _literal(at, entry + 1, byte(entry).value)
        elif step.kind == USED:
            at = _header(at, inputs, 0x90, 0xDC)
            for i in range(inputs):
                at = _integer(at, word(used + 8 * i))
    return at
