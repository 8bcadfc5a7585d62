"""The WebAssembly object that LLVM emits as a module that can be loaded.

An object of one module needs no linker: its code refers to functions, data and table at their final places.
What is missing are the exports, which this adds. Formats: WebAssembly Core Specification, binary format; and
https://github.com/WebAssembly/tool-conventions/blob/main/Linking.md for the names of functions.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

MAGIC = b"\0asm\1\0\0\0"
CUSTOM, IMPORT, EXPORT, START, ELEMENT, DATA_COUNT, CODE, DATA = 0, 2, 7, 8, 9, 12, 10, 11  # sections
SYMBOLS = 8  # part of the section `linking`
FUNCTION, VARIABLE, SECTION = 0, 1, 3  # kinds of symbols
UNDEFINED, EXPLICIT_NAME = 0x10, 0x40  # flags of a symbol
CONSTANT = 0x41  # i32.const, which begins the place of data and of the table's elements


class Linked(NamedTuple):
    """A module that can be loaded.

    code      its bytes
    table     index in the function table of each function whose address is taken
    data      first byte of the memory that its static data leave free
    imported  names of the functions that it lacks
    """

    code: bytes
    table: dict[str, int]
    data: int
    imported: tuple[str, ...]


class _Bytes:
    """Reads an object from front to back."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    def number(self) -> int:
        """An integer in LEB128, without sign."""
        result = shift = 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            result |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return result

    def take(self, count: int) -> bytes:
        self.at += count
        return self.data[self.at - count : self.at]

    def name(self) -> str:
        return self.take(self.number()).decode()

    def place(self) -> int:
        """A constant expression: a place in memory or in the table."""
        assert self.take(1)[0] == CONSTANT
        place = self.number()  # below 2^31, and LLVM pads it to five bytes, so that its sign does not matter
        self.take(1)
        return place


def finish(data: bytes, exports: Mapping[str, str]) -> Linked:
    """The module of an object.

    exports  the name outside of each function to export, by its name inside
    """
    sections = list(_sections(data))
    by_kind = dict(sections)
    names = dict(_function_names(sections))
    numbers = {name: number for number, name in names.items()}
    exported = b"".join(_text(outer) + b"\0" + _encoded(numbers[inner]) for inner, outer in exports.items())
    addition = EXPORT, _encoded(len(exports)) + exported
    kept = [(kind, content) for kind, content in sections if kind != CUSTOM]
    after = next(n for n, (kind, _) in enumerate(kept) if kind in (START, ELEMENT, DATA_COUNT, CODE, DATA))
    kept.insert(after, addition)
    code = MAGIC + b"".join(bytes([kind]) + _encoded(len(content)) + content for kind, content in kept)
    table = {names[number]: place for place, number in _elements(by_kind.get(ELEMENT, b"\0")) if number in names}
    return Linked(code, table, _data_end(by_kind.get(DATA, b"\0")), tuple(_imported(by_kind.get(IMPORT, b"\0"))))


def _sections(data: bytes) -> Iterator[tuple[int, bytes]]:
    source = _Bytes(data, len(MAGIC))
    while source.at < len(data):
        kind = source.take(1)[0]
        yield kind, source.take(source.number())


def _function_names(sections: list[tuple[int, bytes]]) -> Iterator[tuple[int, str]]:
    """Number and name of each function that the object defines."""
    customs = (_Bytes(content) for kind, content in sections if kind == CUSTOM)
    source = next(custom for custom in customs if custom.name() == "linking")
    source.number()  # version
    while source.at < len(source.data):
        kind, size = source.take(1)[0], source.number()
        if kind == SYMBOLS:
            break
        source.take(size)
    for _ in range(source.number()):
        kind, flags = source.take(1)[0], source.number()
        if kind == VARIABLE:
            source.name()
            for _ in range(0 if flags & UNDEFINED else 3):
                source.number()
        elif kind == SECTION:
            source.number()
        else:
            number = source.number()
            if not flags & UNDEFINED or flags & EXPLICIT_NAME:
                name = source.name()
                if kind == FUNCTION and not flags & UNDEFINED:
                    yield number, name


def _elements(content: bytes) -> Iterator[tuple[int, int]]:
    """Place in the table and number of each function."""
    source = _Bytes(content)
    for _ in range(source.number()):
        flags = source.number()
        if flags & 2:
            source.number()
        place = source.place()
        if flags & 2:
            source.take(1)
        for _ in range(source.number()):
            yield place, source.number()
            place += 1


def _data_end(content: bytes) -> int:
    """First byte after all static data."""
    source, end = _Bytes(content), 0
    for _ in range(source.number()):
        source.number()
        place = source.place()
        size = source.number()
        source.take(size)
        end = max(end, place + size)
    return end


def _imported(content: bytes) -> Iterator[str]:
    """Names of imported functions."""
    source = _Bytes(content)
    for _ in range(source.number()):
        source.name()
        name, kind = source.name(), source.take(1)[0]
        if kind == 0:
            source.number()
            yield name
        elif kind == 3:  # a global: type, whether it changes
            source.take(2)
        else:  # a table, whose type precedes its limits, or a memory
            source.take(1 if kind == 1 else 0)
            for _ in range(1 + (source.number() & 1)):
                source.number()


def _encoded(number: int) -> bytes:
    """LEB128."""
    result = bytearray()
    while number > 127:
        result.append(number & 127 | 128)
        number >>= 7
    return bytes([*result, number])


def _text(text: str) -> bytes:
    return _encoded(len(text.encode())) + text.encode()
