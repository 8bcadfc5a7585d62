"""Vertices and polygons of a PLY file: text, or binary in either byte order; triangles, quads, polygons and strips.

A PLY file has a header of elements, each with a number of rows and properties, then the rows. A property is a number,
or a list with its length before it. Read are x, y, z of `vertex`, the list `vertex_indices` (or `vertex_index`) of
`face`, and that of `tristrips`, in which -1 begins another strip. G. Turk, The PLY Polygon File Format, 1994.
"""

import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from palpate.nodes.base.mesh_formats.polygons import FileMesh
from palpate.nodes.base.mesh_formats.words import numbers_or_nan, plain_lines, shown, wrong_word
from palpate.physics.indices import check_indices

LONGEST_HEAD = 1 << 20  # [bytes]
BLOCK = 1 << 20  # Corners that are gathered at once
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
"""Names of types, the 64-bit integers as some programs write them."""
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")
COORDINATES = ("x", "y", "z")
_END = re.compile(rb"^[ \t]*end_header[ \t]*$", re.MULTILINE)


class Property(NamedTuple):
    """Its type as numpy names it; `length`: that of a list's length, "" for a single number."""

    name: str
    type: str
    length: str = ""


@dataclass
class Element:
    """A table of the file: its number of rows and its columns."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def lists(self) -> list[Property]:
        return [each for each in self.properties if each.length]


class Lists(NamedTuple):
    """A column of lists: all entries (n), and the length of each row (rows)."""

    entries: np.ndarray
    lengths: np.ndarray


Columns = dict[str, np.ndarray | Lists]


def read_ply(data: bytes) -> FileMesh:
    """The mesh in the bytes of a file. ValueError: what is wrong, and where."""
    order, elements, at = _header(data)
    columns: dict[str, Columns] = {}
    notes = []
    if order:
        for element in elements:
            columns[element.name], at = _binary_rows(data, at, element, order)
        if rest := len(data) - at:
            notes.append(f"{rest} bytes after its last element are ignored")
    else:
        lines = [line for line in plain_lines(data[at:]) if line.strip()]
        row = 0
        for element in elements:
            columns[element.name] = _text_rows(lines[row : row + element.count], element)
            row += element.count if element.properties else 0
        if rest := len(lines) - row:
            notes.append(f"{rest} lines after its last element are ignored")
    vertices = _vertices(columns)
    corners, counts = _polygons(elements, columns, len(vertices))
    cut = "its last line has no end: it may be cut off there" if not order and data[-1:] not in b"\r\n" else ""
    return FileMesh(vertices, corners, counts, notes, cut)


# -- header ----------------------------------------------------------------------------------------------------------


def _header(data: bytes) -> tuple[str, list[Element], int]:
    """Byte order ("": text), elements, and where their rows begin."""
    head = data[:LONGEST_HEAD]
    first = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)
    if not first:
        raise ValueError(f"it begins with {shown(data[:20])}, expected a line `ply`")
    # Binary rows may begin with the byte of a line feed, so the ends of lines are those of the first line.
    end = re.compile(b"end_header[ \t]*" + first[1]).search(head)
    if not end:
        raise ValueError("its header has no line `end_header`: it is cut off or damaged")
    order, elements = None, list[Element]()
    for line in plain_lines(head[: end.start()])[1:]:
        match line.decode(errors="replace").split():
            case ["format", kind, _] if kind in FORMATS:
                order = FORMATS[kind]
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(Element(name, int(count)))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= TYPES.keys():
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header has the line {shown(line)}, which is not one of a PLY file")
    if order is None:
        raise ValueError(f"its header has no line `format`, expected one of {', '.join(FORMATS)}")
    return order, elements, end.end()


# -- rows ------------------------------------------------------------------------------------------------------------


def _too_few(element: Element, room: int) -> ValueError:
    return ValueError(f"its header announces {element.count} rows of {element.name}, the file has room for {room}: it "
                      "is cut off or damaged")  # fmt: skip


def _binary_rows(data: bytes, at: int, element: Element, order: str) -> tuple[Columns, int]:
    """The columns of an element whose rows begin at this byte, and where they end."""
    least = sum(np.dtype(each.length or each.type).itemsize for each in element.properties)  # bytes of a row
    if least * element.count > len(data) - at:
        raise _too_few(element, (len(data) - at) // least)
    if not (element.count and element.properties):
        return {}, at
    if not element.lists:
        kinds = np.dtype([(f"{k}", order + each.type) for k, each in enumerate(element.properties)])
        table = np.frombuffer(data, kinds, element.count, at)
        return {p.name: table[f"{k}"] for k, p in enumerate(element.properties)}, at + kinds.itemsize * element.count
    starts, lengths, end = _equal_rows(data, at, element, order) or _walk(data, at, element, order)
    found: Columns = {}
    column, place = 0, starts[0] - np.dtype(element.lists[0].length).itemsize  # of the next property of each row
    place = place - sum(
        np.dtype(p.type).itemsize for p in element.properties[: element.properties.index(element.lists[0])]
    )
    for each in element.properties:
        size = np.dtype(each.type).itemsize
        if not each.length:
            if each.name in COORDINATES:
                found[each.name] = _gather(data, place, np.ones(element.count, np.int64), order + each.type)
            place = place + size
            continue
        if each.name in CORNERS or len(element.lists) == 1:
            found[each.name] = Lists(_gather(data, starts[column], lengths[column], order + each.type), lengths[column])
        place = starts[column] + size * lengths[column]
        column += 1
    return found, end


def _equal_rows(data: bytes, at: int, element: Element, order: str) -> tuple[np.ndarray, np.ndarray, int] | None:
    """As `_walk`, without a loop over the rows, if the lists of all rows are as long as in the first; else None."""
    one = Element(element.name, 1, element.properties)
    starts, lengths, end = _walk(data, at, one, order)
    size = end - at
    if size * element.count > len(data) - at:
        return None
    table = np.frombuffer(data, np.uint8, size * element.count, at).reshape(element.count, size)
    for each, begin, length in zip(element.lists, starts[:, 0], lengths[:, 0], strict=True):
        width = np.dtype(each.length).itemsize
        given = np.ascontiguousarray(table[:, begin - at - width : begin - at]).view(order + each.length)
        if (given != length).any():
            return None
    return (
        starts + size * np.arange(element.count),
        np.repeat(lengths, element.count, axis=1),
        end + size * (element.count - 1),
    )


def _walk(data: bytes, at: int, element: Element, order: str) -> tuple[np.ndarray, np.ndarray, int]:
    """First byte and length of each list (lists, rows), and where the rows end."""
    gaps, sizes, gap = [], [], 0  # bytes before each list; of its length and of an entry
    for each in element.properties:
        if each.length:
            gaps.append(gap)
            sizes.append((np.dtype(each.length).itemsize, each.length[0] == "i", np.dtype(each.type).itemsize))
        gap = 0 if each.length else gap + np.dtype(each.type).itemsize
    endian, size = ("little" if order == "<" else "big"), len(data)
    starts, lengths = [list[int]() for _ in sizes], [list[int]() for _ in sizes]
    for row in range(element.count):
        for begin, number, before, (width, signed, item) in zip(starts, lengths, gaps, sizes, strict=True):
            at += before
            length = int.from_bytes(data[at : at + width], endian, signed=signed)  # type: ignore[arg-type]
            at += width
            if length < 0:
                raise ValueError(f"row {row + 1} of {element.name} has a list of {length} entries: it is damaged")
            begin.append(at)
            number.append(length)
            at += item * length
        at += gap
        if at > size:
            raise _too_few(element, row)
    return np.array(starts, np.int64), np.array(lengths, np.int64), at


def _gather(data: bytes, starts: np.ndarray, lengths: np.ndarray, kind: str) -> np.ndarray:
    """The entries (n) of the lists that begin at these bytes."""
    size, content = np.dtype(kind).itemsize, np.frombuffer(data, np.uint8)
    entries = np.empty(int(lengths.sum()), np.dtype(kind))
    end = np.cumsum(lengths)
    for first in range(0, len(entries), BLOCK):
        number = np.arange(first, min(first + BLOCK, len(entries)))
        row = np.searchsorted(end, number, side="right")
        place = starts[row] + size * (number - end[row] + lengths[row])
        entries[number] = np.ascontiguousarray(content[place[:, None] + np.arange(size)]).view(kind)[:, 0]
    return entries


def _text_rows(lines: list[bytes], element: Element) -> Columns:
    """The columns of an element from its lines."""
    if not (element.count and element.properties):
        return {}
    if len(lines) < element.count:
        raise _too_few(element, len(lines))
    words = b" ".join(lines).split()
    try:
        values = numbers_or_nan(words)
    except ValueError:
        raise ValueError(f"the rows of {element.name} have {wrong_word(words, float)}, expected numbers") from None
    if not element.lists:
        width = len(element.properties)
        if len(values) != width * element.count:
            raise _wrong_row(lines, element)
        table = values.reshape(-1, width)
        return {each.name: table[:, k] for k, each in enumerate(element.properties)}
    starts, lengths = _walk_words(values.tolist(), lines, element)
    found: Columns = {}
    for each, begin, number in zip(element.properties, starts, lengths, strict=True):
        place = np.repeat(begin - np.cumsum(number) + number, number) + np.arange(number.sum())
        found[each.name] = Lists(values[place], number) if each.length else values[place]
    return found


def _walk_words(values: list[float], lines: list[bytes], element: Element) -> tuple[np.ndarray, np.ndarray]:
    """First word and number of words (properties, rows) of each property, without the length of a list."""
    at, size = 0, len(values)
    starts, lengths = [list[int]() for _ in element.properties], [list[int]() for _ in element.properties]
    for _ in range(element.count):
        for each, begin, number in zip(element.properties, starts, lengths, strict=True):
            length = 1.0
            if each.length:
                length = values[at] if at < size else -1.0
                at += 1
            if not (length >= 0.0 and length == int(length) and at + length <= size):
                raise _wrong_row(lines, element)
            begin.append(at)
            number.append(int(length))
            at += int(length)
    if at != size:
        raise _wrong_row(lines, element)
    return np.array(starts), np.array(lengths)


def _wrong_row(lines: list[bytes], element: Element) -> ValueError:
    """The first row whose number of words is not that of its properties."""
    for number, line in enumerate(lines[: element.count], 1):
        words, at = line.split(), 0
        for each in element.properties:
            at += 1
            if each.length and at <= len(words) and words[at - 1].isdigit():
                at += int(words[at - 1])
        if at != len(words):
            cut = ": it is cut off" if number == len(lines) else ""
            return ValueError(f"row {number} of {element.name} is {shown(line)}, expected {at} numbers{cut}")
    return ValueError(f"the rows of {element.name} do not match its properties: it is damaged")


# -- mesh ------------------------------------------------------------------------------------------------------------


def _vertices(columns: dict[str, Columns]) -> np.ndarray:
    found = columns.get("vertex", {})
    if missing := [name for name in COORDINATES if not isinstance(found.get(name), np.ndarray)]:
        raise ValueError(f"its element vertex has no {', '.join(missing)}, or no rows")
    return np.stack([np.asarray(found[name], dtype=float) for name in COORDINATES], axis=1)


def _polygons(elements: list[Element], columns: dict[str, Columns], total: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n) of the faces and strips, and their number for each polygon."""
    corners, counts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for element in elements:
        if element.name not in ("face", "tristrips") or not element.count:
            continue
        lists = [each.name for each in element.lists]
        name = next((name for name in CORNERS if name in lists), lists[0] if len(lists) == 1 else "")
        column = columns[element.name].get(name)
        if not isinstance(column, Lists):
            raise ValueError(f"its element {element.name} has no list {CORNERS[0]}; found {', '.join(lists) or 'none'}")
        if element.name == "face":
            what = "a face has the vertex"
            corners.append(check_indices(column.entries, total, what))
            counts.append(column.lengths)
        else:
            triangles = _strips(
                check_indices(column.entries, total, "a strip has the vertex", least=-1), column.lengths
            )
            corners.append(triangles.ravel())
            counts.append(np.full(len(triangles), 3))
    if not sum(map(len, counts)):
        raise ValueError(f"it has {total} vertices and no faces: it is a cloud of points")
    return np.concatenate(corners), np.concatenate(counts)


def _strips(corners: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The triangles (T,3) of strips: each corner after the first two of a strip ends one, and every second one is
    turned round. Triangles with two equal corners only join strips."""
    place = np.arange(len(corners))
    begins = np.zeros(len(corners), dtype=bool)
    begins[(np.cumsum(lengths) - lengths)[lengths > 0]] = True
    begins[1:] |= corners[:-1] < 0
    since = place - np.maximum.accumulate(np.where(begins, place, 0))
    last = np.flatnonzero((since >= 2) & (corners >= 0))
    turned = since[last] % 2
    found = np.stack([corners[last - 2 + turned], corners[last - 1 - turned], corners[last]], axis=1)
    a, b, c = found.T
    return found[(a != b) & (b != c) & (c != a)]
