"""The bytecode of a function without what does not change its meaning, and the names that it looks up.

Docstrings, line numbers and file names leave the hash as it is: instructions take the place of constants and names by
their values, so that it does not matter whether a docstring is the first constant.
"""

import dis
import hashlib
import sys
from functools import cache
from types import CodeType
from typing import Any, NamedTuple

Path = tuple[str, ...]
"""A global name and the attributes that are read from it: ("np", "float64")."""

_CONSTANT, _NAME, _EXTENDED, _OPERATION, _SMALL = range(1, 6)
_SHIFTS = {"LOAD_GLOBAL": 1, "LOAD_ATTR": int(sys.version_info >= (3, 12)), "LOAD_SUPER_ATTR": 2}
"""Bits of an argument below the number of its name; they select a form of the instruction."""
_SHIFT = {dis.opmap[name]: bits for name, bits in _SHIFTS.items() if name in dis.opmap}
_GLOBALS = {dis.opmap[name] for name in ("LOAD_GLOBAL", "LOAD_NAME") if name in dis.opmap}
_ATTRIBUTES = {dis.opmap[name] for name in ("LOAD_ATTR", "LOAD_METHOD") if name in dis.opmap}
_IMPORT, _STORE = dis.opmap["IMPORT_NAME"], dis.opmap["STORE_NAME"]
_POWERS = {8, 21}  # `**` and `**=` as arguments of BINARY_OP (NB_POWER, NB_INPLACE_POWER)
_LINES = {"__doc__", "__firstlineno__"}  # set by the code of modules and classes
_DOCUMENTED = 0x4000000  # CO_HAS_DOCSTRING since Python 3.13


def _kinds() -> bytes:
    kinds = bytearray(256)
    for group, kind in ((dis.hasconst, _CONSTANT), (dis.hasname, _NAME)):
        for operation in group:
            if operation < 256:
                kinds[operation] = kind
    kinds[dis.EXTENDED_ARG], kinds[dis.opmap["BINARY_OP"]] = _EXTENDED, _OPERATION
    if "LOAD_SMALL_INT" in dis.opmap:
        kinds[dis.opmap["LOAD_SMALL_INT"]] = _SMALL
    return bytes(kinds)


_KINDS = _kinds()


class Code(NamedTuple):
    """What a code object and those inside it do.

    digest   hash of instructions, constants and names
    paths    global names with attributes, in the order of their use
    imports  modules that it imports
    names    all names of globals and attributes
    power    whether it raises to a power that is no constant integer
    """

    digest: str
    paths: tuple[Path, ...]
    imports: tuple[str, ...]
    names: frozenset[str]
    power: bool


@cache
def read_code(code: CodeType) -> Code:
    """The meaning of a code object."""
    reader = _Reader(code)
    inner = [read_code(each) for each in code.co_consts if isinstance(each, CodeType)]
    known = (
        code.co_name, code.co_flags & ~_DOCUMENTED, code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount,
        code.co_varnames, code.co_cellvars, code.co_freevars, code.co_exceptiontable, bytes(reader.raw), reader.words,
    )  # fmt: skip
    return Code(
        hashlib.sha256(repr(known).encode()).hexdigest(),
        tuple(dict.fromkeys([*reader.paths, *(path for each in inner for path in each.paths)])),
        tuple(dict.fromkeys([*reader.imports, *(name for each in inner for name in each.imports)])),
        frozenset(reader.names).union(*(each.names for each in inner)),
        reader.power or any(each.power for each in inner),
    )


class _Reader:
    """Instructions of a code object, without numbers of constants and names.

    raw    instructions;  words  their names and constants, in the order of their use
    """

    def __init__(self, code: CodeType) -> None:
        self.raw = bytearray(code.co_code)
        self.words: list[str] = []
        self.paths: list[Path] = []
        self.imports: list[str] = []
        self.names: set[str] = set()
        self.power = False
        self._code, high, last = code, 0, -1
        self._path: Path = ()
        operations = bytes(self.raw[::2])
        for at, kind in enumerate(operations.translate(_KINDS)):
            if not kind:
                continue
            adjacent = not any(operations[last + 1 : at])  # inline caches of instructions are 0
            if not adjacent:
                self._end_path()
            argument = self.raw[2 * at + 1] | (high if adjacent else 0)
            high = argument << 8 if kind == _EXTENDED else 0
            if kind == _CONSTANT:
                self._end_path()
                self.raw[2 * at + 1] = 0
                self.words.append(_word(code.co_consts[argument]))
            elif kind == _NAME:
                self._read_name(operations[at], argument, at, last)
            elif kind == _SMALL:
                self.words.append(f"int:{argument}")
            elif kind == _OPERATION and argument in _POWERS:
                self.power = self.power or not (adjacent and self.words and self.words[-1].startswith("int:"))
            last = at
        self._end_path()

    def _read_name(self, operation: int, argument: int, at: int, last: int) -> None:
        shift = _SHIFT.get(operation, 0)
        name = self._code.co_names[argument >> shift]
        self.raw[2 * at + 1] &= (1 << shift) - 1
        if operation == _STORE and name in _LINES:
            self.words.pop()
            self.raw[2 * last : 2 * last + 2] = self.raw[2 * at : 2 * at + 2] = b"\0\0"
            return
        self.words.append(f"name:{name}")
        self.names.add(name)
        if operation in _ATTRIBUTES and self._path:
            self._path = (*self._path, name)
            return
        self._end_path()
        if operation in _GLOBALS:
            self._path = (name,)
        elif operation == _IMPORT:
            self.imports.append(name)

    def _end_path(self) -> None:
        if self._path:
            self.paths.append(self._path)
        self._path = ()


def _word(constant: Any) -> str:
    """A constant as text, which differs for 1, 1.0 and True."""
    if isinstance(constant, CodeType):
        return f"code:{read_code(constant).digest}"
    if isinstance(constant, tuple):
        return f"tuple:{[_word(each) for each in constant]!r}"
    if isinstance(constant, frozenset):
        return f"frozenset:{sorted(map(_word, constant))!r}"
    return f"{type(constant).__name__}:{constant!r}"
