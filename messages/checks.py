"""Checks of a message: of types and shapes when it is created, of finite numbers before it is sent.

Both run for every message of every tick. So a straight-line function is generated for each message type from its fields
on first use, as dataclasses do. The slow checks, which produce the error message, run only when that function fails.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
import numpy as np

from palpate.messages.fields import Field, MessageError, Vector, fields

_vdot = getattr(np.vdot, "_implementation", np.vdot)
"""`np.vdot` without numpy's dispatch to array types of other packages, which takes longer than the product."""


class _Settling(dict[type, Callable[[Any], None]]):
    def __missing__(self, kind: type) -> Callable[[Any], None]:
        written = self[kind] = _write_settle(kind)
        return written


SETTLE = _Settling()
"""By message type, the function that converts the fields of a new message to their declared form: numbers to floats,
vectors to tuples of the declared length, arrays to read-only contiguous ones of the declared dtype and shape. Writable
arrays are copied, so the sender can reuse its buffers.

MessageError: a field cannot be converted.
"""


def check_finite(message: Any) -> None:
    """MessageError: a field contains NaN or infinity; names the field, the index and the value."""
    kind: Any = type(message)
    for field in () if finite_check(kind)(message) else fields(kind):
        value = getattr(message, field.name)
        if field.type is not float and not field.shape:
            continue
        array = np.asarray(value)
        if array.dtype.kind != "f" or np.isfinite(array).all():
            continue
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        where = f" at index {place if len(place) > 1 else place[0]}" if place else ""
        raise MessageError(
            f"{kind.__name__}.{field.name} [{field.unit}]: found {float(array[place])}{where}, expected a finite number"
        )


def _write_settle(kind: type) -> Callable[[Any], None]:
    names: dict[str, Any] = {"settle_all": _settle_all, "set": msgspec.structs.force_setattr}
    lines, known = ["def settle(m):"], set[str]()
    for field in fields(kind):
        lines.append(f"    v = m.{field.name}")
        if field.dtype is not None:
            names |= {"ndarray": np.ndarray, f"dtype_{field.name}": field.dtype}
            lines += _settle_array(field, known)
            continue
        wrong = [f"type(v) is not {(tuple if field.shape else field.type).__name__}"]
        if field.shape:
            element, length = field.element, field.shape[0]
            if isinstance(length, int):
                wrong += [f"len(v) != {length}", *(f"type(v[{i}]) is not {element.__name__}" for i in range(length))]
            else:
                wrong.append(f"v and not only_{element.__name__}(map(type, v))")
                names[f"only_{element.__name__}"] = frozenset((element,)).issuperset
        lines.append(f"    if {' or '.join(wrong)}: return settle_all(m)")
    return _function("settle", [*lines, "    return None"], names)


def _settle_array(field: Field, known: set[str]) -> list[str]:
    """Code for an array field: check it, and copy it if its sender could still write to it.

    known  symbolic lengths that earlier lines have set; new ones are added
    """
    name, other = field.name, "return settle_all(m)"
    lengths, tests = [], []
    for axis, length in enumerate(field.shape):
        new = isinstance(length, str) and length not in known
        lengths.append(f"length_{length}" if new else f"axis_{axis}")
        if not new:
            tests.append(f"axis_{axis} != {f'length_{length}' if isinstance(length, str) else length}")
        elif isinstance(length, str):
            known.add(length)
    return [
        f"    if type(v) is not ndarray or v.dtype is not dtype_{name} or v.ndim != {len(field.shape)}: {other}",
        f"    [{', '.join(lengths)}] = v.shape",
        *([f"    if {' or '.join(tests)}: {other}"] if tests else []),
        "    flags = v.flags",
        "    if flags.writeable:",
        "        v = v.copy()",
        "        v.setflags(False)",
        f"        set(m, {name!r}, v)",
        f"    elif not flags.c_contiguous: {other}",
    ]


def check_plausible(message: Any) -> None:
    """MessageError: a field contains NaN, infinity, or a number beyond its bound (`fields.MOST`, `fields.Bound`);
    names the field, the index and the value. For messages of nodes in Python: one wrong number would stop the hand's
    force without a sign."""
    check_finite(message)
    kind: Any = type(message)
    for field in () if plausible_check(kind)(message) else fields(kind):
        most, array = field.most, np.asarray(getattr(message, field.name))
        if array.dtype.kind == "f" and len(wrong := np.argwhere(np.abs(array) > most)):
            place = tuple(wrong[0].tolist())
            where = f" at index {place if len(place) > 1 else place[0]}" if place else ""
            raise MessageError(
                f"{kind.__name__}.{field.name} [{field.unit}]: found {float(array[place]):g}{where}, expected at most "
                f"{most:g}{', ' + field.why if field.why else ''}"
            )


@cache
def plausible_check(kind: type) -> Callable[[Any], bool]:
    """The fast check of a message type. True: all numbers are finite, and none is beyond its bound. False:
    `check_plausible` decides."""
    tests = ["finite(m)"]
    for field in fields(kind):
        most, name = field.most, field.name
        if most == math.inf or (field.dtype is not None and field.dtype.kind != "f"):
            continue
        if field.dtype is not None:
            tests.append(f"(not len(m.{name}) or vdot(m.{name}, m.{name}) <= {most * most!r})")
        elif field.type is float:
            tests.append(f"-{most!r} <= m.{name} <= {most!r}")
        elif field.element is float:
            tests.append(f"(not m.{name} or (min(m.{name}) >= -{most!r} and max(m.{name}) <= {most!r}))")
    lines = ["def plausible(m):", f"    return {' and '.join(tests)}"]
    return _function("plausible", lines, {"finite": finite_check(kind), "vdot": _vdot})


@cache
def finite_check(kind: type) -> Callable[[Any], bool]:
    """The fast check of a message type. True: all numbers are finite. False: a number is not finite, or the sum of very
    large ones overflows; `check_finite` decides which.

    It tests whether the sum of all numbers, of squares for arrays, is finite. NaN and infinity survive every sum, and
    BLAS does not warn when a sum overflows.
    """
    lines, terms, tests = ["def finite(m):"], [], []
    for field in fields(kind):
        name = field.name
        if field.dtype is not None:
            if field.dtype.kind == "f":
                lines.append(f"    {name} = m.{name}")
                tests.append(f"(not len({name}) or isfinite(vdot({name}, {name})))")
        elif field.type is float:
            terms.append(f"m.{name}")
        elif field.shape and field.element is float:
            length = field.shape[0]
            if isinstance(length, int):  # faster than `sum`
                numbers = [f"{name}_{i}" for i in range(length)]
                lines.append(f"    [{', '.join(numbers)}] = m.{name}")
                terms += numbers
            else:
                terms.append(f"sum(m.{name})")
    tests = ([f"isfinite({' + '.join(terms)})"] if terms else []) + tests
    lines.append(f"    return {' and '.join(tests) or 'True'}")
    return _function("finite", lines, {"isfinite": math.isfinite, "vdot": _vdot})


def _function(name: str, lines: list[str], names: dict[str, Any]) -> Callable:
    exec("\n".join(lines), names)  # safe: field names are identifiers of an existing class
    return names[name]


def _number(kind: type, field: Field, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise MessageError(f"{kind.__name__}.{field.name}: found {value!r}, expected a number [{field.unit}]") from None


def _plain(kind: type, field: Field, value: Any) -> Any:
    """Text, integers and flags; numpy scalars are converted."""
    scalar = value.item() if isinstance(value, np.generic) else value
    if (isinstance(scalar, str) and field.type is str) or type(scalar) is field.type:
        return field.type(scalar)
    raise MessageError(f"{kind.__name__}.{field.name}: found {value!r}, expected {field.type.__name__} [{field.unit}]")


def _tuple(kind: type, field: Field, value: Any) -> Vector:
    try:
        vector = tuple(map(field.element, value))
    except (TypeError, ValueError):
        raise MessageError(
            f"{kind.__name__}.{field.name}: found {value!r}, expected {field.shape} numbers [{field.unit}]"
        ) from None
    if isinstance(field.shape[0], int) and len(vector) != field.shape[0]:
        raise MessageError(
            f"{kind.__name__}.{field.name}: found {len(vector)} numbers, expected {field.shape[0]} [{field.unit}]"
        )
    return vector


def _array(kind: type, field: Field, value: Any, lengths: dict[str, int]) -> np.ndarray:
    try:
        if isinstance(value, np.ndarray) and not value.flags.writeable and value.dtype == field.dtype:
            array = np.ascontiguousarray(value)
        else:
            array = np.array(value, dtype=field.dtype, order="C")
    except (TypeError, ValueError):
        raise MessageError(f"{kind.__name__}.{field.name}: not an array of {field.dtype} [{field.unit}]") from None
    fits = array.ndim == len(field.shape) and all(
        length == (lengths.setdefault(want, length) if isinstance(want, str) else want)
        for want, length in zip(field.shape, array.shape, strict=True)
    )
    if not fits:
        want = tuple(lengths.get(s, s) if isinstance(s, str) else s for s in field.shape)
        raise MessageError(f"{kind.__name__}.{field.name}: found shape {array.shape}, expected {want} [{field.unit}]")
    array.flags.writeable = False
    return array


def _settle_all(message: Any) -> None:
    """Convert each field to its declared form. MessageError: a field cannot be converted."""
    kind: Any = type(message)
    lengths: dict[str, int] = {}
    for field in fields(kind):
        value = getattr(message, field.name)
        if field.dtype is not None:
            value = _array(kind, field, value, lengths)
        elif field.shape:
            value = _tuple(kind, field, value)
        else:
            value = _number(kind, field, value) if field.type is float else _plain(kind, field, value)
        msgspec.structs.force_setattr(message, field.name, value)
