"""Plan of a message's wire format: a sequence of literal bytes (keys and headers) and values of its record, which
`encode` and `decode` execute in compiled code."""

import functools
import math

import msgspec
import numpy as np

from palpate.messages import Message, fields
from palpate.messages.base import HEADER
from palpate.messages.record import layout

MAP, FLOATS, INTEGER, FLAG, VECTOR, ARRAY, WORD, SOURCE, USED, DELAYED = range(10)
STEP = np.dtype([(name, "<i8") for name in ("kind", "at", "count", "first", "length", "size", "more", "axes")])
"""One part of a message.

kind    of its value (`MAP`, `FLOATS` ...);  at  offset of the value in the record
first, length  of the literal bytes before it
more    offset of the table of words; for an array 1 if an empty one is omitted
count   of numbers, axes of an array, words, or fields of the map;  size [bytes] of an element
axes    of an array: index of the first of its lengths in `WirePlan.axes`
"""
SLACK = 8
"""Bytes behind the literals and behind an encoded message that the encoder may read or change."""
_pack = msgspec.msgpack.encode


class WirePlan:
    """Wire form of the messages of one output.

    steps     (k,) of `STEP`
    literals  literal bytes of all steps
    axes      lengths of the axes of all arrays: n for n numbers, -1 - n for the n-th symbolic length of the message
    letters   number of symbolic lengths
    most      upper bound [bytes] of a message without its arrays
    """

    def __init__(self, kind: type[Message], source: str) -> None:
        record = layout(kind)
        self._literals, self._axes, self._letters = bytearray(), list[int](), dict[str, int]()
        given = {field.name: field for field in fields(kind)}
        defaults = {field.name: field.default for field in msgspec.structs.fields(kind)}
        names = kind.__struct_fields__
        omits = kind.__struct_config__.omit_defaults  # then empty arrays are left out
        rare = [n for n in names if n in given and isinstance(defaults[n], np.ndarray) and omits]
        steps = [self._step(MAP, 0, len(names) - len(rare) - 1, b"")]  # without `delayed`
        for name in names:
            key = _pack(name)
            if name == "source":
                steps.append(self._step(SOURCE, 0, 0, key + _pack(source)))
            elif name == "used":
                steps.append(self._step(USED, 0, 0, key))
            elif name == "delayed":
                steps.append(self._step(DELAYED, record.fields[name][1], 1, key))  # type: ignore[index]
            elif name in HEADER:
                steps.append(self._step(INTEGER, record.fields[name][1], 1, key))  # type: ignore[index]
            else:
                steps.append(self._field(given[name], record, key, name in rare))
        self.steps = np.array(steps, STEP)
        self.literals = np.frombuffer(bytes(self._literals) + bytes(SLACK), np.uint8)
        self.axes, self.letters = np.array(self._axes, np.int64), len(self._letters)
        self.most = 2 * record.itemsize + len(self.literals) + 256

    def _step(self, kind: int, at: int, count: int, literal: bytes, size: int = 0, more: int = 0) -> tuple[int, ...]:
        return kind, at, count, self._literal(literal), len(literal), size, more, len(self._axes)

    def _literal(self, data: bytes) -> int:
        self._literals += data
        return len(self._literals) - len(data)

    def _field(self, field, record: np.dtype, key: bytes, rare: bool) -> tuple[int, ...]:
        dtype, at = record.fields[field.name][:2]  # type: ignore[index]
        if field.dtype is not None:
            literal = key + b"\x83" + _pack("dtype") + _pack(field.dtype.str) + _pack("shape")
            step = self._step(ARRAY, at, len(field.shape), literal, field.dtype.itemsize, 1 if rare else -1)
            for length in field.shape:
                letter = isinstance(length, str)
                self._axes.append(-1 - self._letters.setdefault(length, len(self._letters)) if letter else length)
            return step
        if field.words:
            words = [_pack(word) for word in field.words]
            table = b"".join(len(w).to_bytes(1, "little") + w.ljust(31) for w in words)
            return self._step(WORD, at, len(words), key, 0, self._literal(table))
        if dtype.fields is not None:
            return self._step(VECTOR, at, 0, key)
        base, shape = dtype.subdtype or (dtype, ())
        kind = {"f": FLOATS, "i": INTEGER, "b": FLAG}[base.kind]
        header = bytes([0x90 | math.prod(shape)]) if shape else b""
        return self._step(kind, at, math.prod(shape), key + header)


wire_plan = functools.cache(WirePlan)  # of a message type and its sender
