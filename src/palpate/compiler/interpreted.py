"""Kernels as plain Python functions, for a debugger: `NUMBA_DISABLE_JIT=1`.

The intrinsics of this package, for which numba generates code, have a Python function of the same meaning here. A run
is slower by a factor of about 1000; a breakpoint in `compute` stops in each step. Records are read and written in
place, by their address, as in compiled code.
"""

import ctypes
import math
import os
import struct
import sys
from collections.abc import Callable
from fractions import Fraction
from types import FunctionType, ModuleType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np


def _is_disabled() -> bool:
    """numba's setting, without an import of numba where only the environment can hold it."""
    of_environment = "numba" not in sys.modules and not os.path.exists(SETTINGS_FILE)
    if of_environment and os.environ.get("NUMBA_DISABLE_JIT", "") in ("", "0"):
        return False
    import numba

    return bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]


SETTINGS_FILE = ".numba_config.yaml"  # in the working folder
ENABLED: bool = _is_disabled()
"""Whether kernels are plain functions in this process."""


_OF_NUMPY = {"arctan2": "atan2", "arccos": "acos", "arcsin": "asin", "power": "pow"}


class _Module:
    """`math` or `numpy` with the functions of `replaced.REPLACED`."""

    def __init__(self, module: ModuleType, replacement: Callable[[str], Any]) -> None:
        self._module, self._replacement = module, replacement

    def __getattr__(self, name: str) -> Any:
        found = self._replacement(_OF_NUMPY.get(name, name))
        if found is None:
            return getattr(self._module, name)
        return found if self._module is math else np.vectorize(found, otypes=[float])


class _Globals(dict):
    """The global names of a module, in which `math` and `numpy` are a `_Module`."""

    def __init__(self, names: dict[str, Any], replacement: Callable[[str], Any]) -> None:
        super().__init__(__builtins__=names["__builtins__"])
        self._names = names
        self._modules = {id(module): _Module(module, replacement) for module in (math, np)}

    def __getitem__(self, name: str) -> Any:
        value = self._names[name]
        return self._modules.get(id(value), value)


def with_functions(function: Any, replacement: Callable[[str], Any]) -> Any:
    """A copy of a function that computes with the functions of `replaced` instead of those of the C library."""
    code, names = function.__code__, _Globals(function.__globals__, replacement)
    copy = FunctionType(code, names, function.__name__, function.__defaults__, function.__closure__)
    copy.__dict__.update(function.__dict__, __module__=function.__module__, __doc__=function.__doc__)
    copy.__kwdefaults__, copy.__qualname__ = function.__kwdefaults__, function.__qualname__
    copy.__annotations__, copy.__wrapped__ = function.__annotations__, function  # type: ignore[attr-defined]
    return copy


class Record:
    """A record in memory: fields are read and written as attributes. An entry for an array has the fields `address` and
    `shape`; a group is a `Record`, several groups are `Records`."""

    __slots__ = ("_memory",)

    def __init__(self, memory: np.ndarray) -> None:
        object.__setattr__(self, "_memory", memory)

    def __getattr__(self, name: str) -> Any:
        try:
            value = self._memory[name]
        except (ValueError, IndexError):
            raise AttributeError(f"the record has no field {name!r}: {self._memory.dtype.names}") from None
        if value.dtype.names:
            return Records(value) if value.ndim else Record(value)
        if value.ndim:
            return value
        return value[()] if value.dtype.kind == "f" else value.item()

    def __setattr__(self, name: str, value: Any) -> None:
        self._memory[name] = value


class Records:
    """Several groups of a record, by index."""

    __slots__ = ("_memory",)

    def __init__(self, memory: np.ndarray) -> None:
        self._memory = memory

    def __len__(self) -> int:
        return len(self._memory)

    def __getitem__(self, place: Any) -> Any:
        value = self._memory[place, ...]
        return Records(value) if value.ndim else Record(value)


def array(address: int, shape: Any, dtype: Any) -> np.ndarray:
    """The array of this shape at an address, without a copy."""
    kind, lengths = np.dtype(dtype), tuple(int(length) for length in shape)
    size = kind.itemsize * int(np.prod(lengths))
    if not size:
        return np.zeros(lengths, kind)
    memory: Any = (ctypes.c_char * size).from_address(int(address))
    return np.frombuffer(memory, kind).reshape(lengths)


def record_at(dtype: np.dtype) -> Callable[[int], Record]:
    """As `memory.pointer`."""
    return lambda address: Record(array(address, (), dtype))


def word(address: int) -> int:
    """As `memory.word`."""
    return ctypes.c_int64.from_address(int(address)).value


def set_word(address: int, value: int) -> None:
    """As `memory.set_word`."""
    ctypes.c_int64.from_address(int(address)).value = int(value)


def number(address: int) -> np.float64:
    """As `memory.number`."""
    return np.float64(ctypes.c_double.from_address(int(address)).value)


def copy(to: int, source: int, count: int) -> int:
    """As `memory.copy`."""
    ctypes.memmove(int(to), int(source), int(count))
    return to + count


def set_big(to: int, value: int) -> int:
    """As `memory.set_big`."""
    ctypes.memmove(int(to), struct.pack(">Q", value & (1 << 64) - 1), 8)  # as a shift of 64 bits leaves it
    return to + 8


def big(address: int) -> int:
    """As `memory.big`."""
    return struct.unpack(">q", ctypes.string_at(int(address), 8))[0]


def array_of(dtype: str | np.dtype) -> Callable[[Record], np.ndarray]:
    """As `records.floats`, for elements of this type."""
    return lambda handle: array(handle.address, handle.shape, dtype)


def nth(several: Record, place: int) -> Record:
    """As `records.nth`."""
    return Record(array(several.at[place], (), several._memory.dtype["like"]))


def clear(record: Any) -> None:
    """As `records.clear`, also for a record of numpy."""
    memory = getattr(record, "_memory", record)
    for name in memory.dtype.names:
        memory[name] = np.zeros((), memory.dtype[name])


def unpacking(kind: type) -> Callable[[Record], Any]:
    """As `records.unpacking`."""
    hints = get_type_hints(kind, include_extras=True)

    def member(hint: Any, value: Any) -> Any:
        if hasattr(hint, "__metadata__"):
            return array(value.address, value.shape, hint.__metadata__[0])
        if get_origin(hint) is tuple:
            return tuple(value[: len(get_args(hint))])
        return unpacking(hint)(value) if isinstance(value, Record) else value

    return lambda record: kind(*(member(hint, getattr(record, name)) for name, hint in hints.items()))


def inner(a: np.ndarray, b: np.ndarray, lanes: int) -> Any:
    """As `dot.inner`, with the same partial sums."""
    whole = len(a) // lanes * lanes
    sums = np.zeros(lanes, a.dtype)
    for start in range(0, whole, lanes):
        sums += a[start : start + lanes] * b[start : start + lanes]
    while len(sums) > 1:
        sums = sums[: len(sums) // 2] + sums[len(sums) // 2 :]
    total = sums[0]
    for k in range(whole, len(a)):
        total += a[k] * b[k]
    return total


def bits(x: float) -> int:
    """As `doubles.bits`."""
    return struct.unpack("<q", struct.pack("<d", x))[0]


def with_bits(word: int) -> float:
    """As `doubles.with_bits`."""
    return struct.unpack("<d", struct.pack("<q", word))[0]


def fused(a: float, b: float, c: float) -> float:
    """As `doubles.fused`."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    total = Fraction(a) * Fraction(b) + Fraction(c)
    return float(total) if total else a * b + c


_FUNCTIONS: list[tuple[Callable[..., Any], tuple[np.dtype, ...]]] = []


def address(function: Callable[..., Any], *dtypes: np.dtype) -> int:
    """A number for a function on these records, for `invoke`, or for one on any values, for `called`; never 0."""
    _FUNCTIONS.append((function, dtypes))
    return len(_FUNCTIONS)


def invoke(function: int, records: int, count: int, dt: float) -> tuple[int, int]:
    """As `records._invoke`: (whether it raised, what it returned)."""
    code, dtypes = _FUNCTIONS[function - 1]
    places = array(records, (count,), np.int64).tolist()
    given = [record_at(dtype)(place) for dtype, place in zip(dtypes, places, strict=True)]
    try:
        with np.errstate(all="ignore"):
            return 0, int(bool(code(*given, np.float64(dt))))
    except ArithmeticError:
        return 1, 0


def called(function: int, *given: Any) -> Any:
    """As a `entry_point.caller`."""
    return _FUNCTIONS[function - 1][0](*given)
