"""Vertices and polygons of a Wavefront OBJ file: its lines `v x y z` and `f a b c ...`.

A corner is the number of a vertex from 1, or a negative number that counts back from the last vertex before the line; a
texture and a normal may follow it after slashes. `#` begins a comment, a backslash continues a line. All other lines
are skipped, and files that they name, such as materials, are not opened.
"""

import re

import numpy as np

from palpate.nodes.base.mesh_formats.polygons import FileMesh
from palpate.nodes.base.mesh_formats.words import integers, numbers, plain_lines, shown, wrong_word

LEAST = 3  # Numbers of a vertex, corners of a face
_VERTEX, _FACE = b"v", (b"f", b"fo")  # the second in files of before 1995
_FOLLOWING = re.compile(rb"/\S*")  # The texture and the normal of a corner


def read_obj(data: bytes) -> FileMesh:
    """The mesh in the bytes of a file. ValueError: what is wrong, and in which line."""
    lines = plain_lines(data)
    ended = not lines[-1].strip()
    while lines and not lines[-1].strip():
        lines.pop()
    coordinates: list[bytes] = []
    corners: list[bytes] = []
    counts, before, faces = [], [], []  # of each face: its corners, the vertices before it, its line
    total, last_face, held = 0, 0, b""
    for number, line in enumerate(lines, 1):
        if held:
            line, held = held + line, b""
        if line.endswith(b"\\"):
            held = line[:-1] + b" "
            continue
        words = line.partition(b"#")[0].split()
        if not words:
            continue
        if words[0] == _VERTEX:
            coordinates += words[1:4]
            total += 1
            if len(coordinates) != LEAST * total:
                raise ValueError(_incomplete(line, number, len(lines), "`v` and three numbers"))
        elif words[0] in _FACE:
            if len(words) <= LEAST:
                raise ValueError(_incomplete(line, number, len(lines), "`f` and three or more corners"))
            corners += words[1:]
            counts.append(len(words) - 1)
            before.append(total)
            faces.append(number)
            last_face = total
    if not total:
        raise ValueError("it has no vertices, lines such as `v 0.1 0 0.2`")
    if not counts:
        raise ValueError(
            f"it has {total} vertices and no faces, lines such as `f 1 2 3`: a cloud of points, or cut off"
        )
    vertices = _vertices(coordinates, ended)
    found = _corners(
        corners, np.array(counts), np.array(before), np.array(faces), total, ended or faces[-1] < len(lines)
    )
    unused = total - int(np.count_nonzero(np.bincount(found, minlength=total)))
    notes = []
    if last_face < total and unused:
        notes.append(f"it ends with {total - last_face} vertices after its last face, as a file does that is cut off")
    cut = f"{unused} of its vertices belong to no face: it is probably cut off" if unused else ""
    if not ended:
        cut = "its last line has no end: it may be cut off there"
    states_none = "an OBJ file does not state its number of faces, so it may be cut off"
    return FileMesh(vertices, found, np.array(counts), notes, cut or states_none)


def _incomplete(line: bytes, number: int, lines: int, expected: str) -> str:
    where = "its last line" if number == lines else f"line {number}"
    return f"{where} is {shown(line)}, expected {expected}" + ": it is cut off" * (number == lines)


def _vertices(coordinates: list[bytes], ended: bool) -> np.ndarray:
    try:
        return numbers(coordinates).reshape(-1, 3)
    except ValueError:
        at = next(i for i, word in enumerate(coordinates) if wrong_word([word], float))
        cut = ": it is cut off" if not ended and at >= len(coordinates) - LEAST else ""
        raise ValueError(f"vertex {at // LEAST + 1} has the coordinate {shown(coordinates[at])}, expected a number with"
                         f" a decimal point{cut}") from None  # fmt: skip


def _corners(
    words: list[bytes], counts: np.ndarray, before: np.ndarray, lines: np.ndarray, total: int, ended: bool
) -> np.ndarray:
    """Indices of vertices (n) from 0.

    words   the corners of all faces
    counts, before, lines  of each face: its corners, the vertices before it, its line
    total   number of vertices
    ended   whether the last face has the end of a line
    """

    def line(at: int) -> int:
        return int(lines[np.searchsorted(np.cumsum(counts), at, side="right")])

    if any(b"/" in word for word in words):
        words = [word.partition(b"/")[0] for word in words]
    try:
        given = integers(words)
    except ValueError:
        at = next(i for i, word in enumerate(words) if wrong_word([word], int))
        raise ValueError(
            f"line {line(at)}: found the corner {shown(words[at])}, expected the number of a vertex"
            + ": it is cut off" * (not ended and at == len(words) - 1)
        ) from None
    found = np.where(given < 0, given + np.repeat(before, counts), given - 1)
    wrong = np.flatnonzero((found < 0) | (found >= total) | (given == 0))
    if len(wrong):
        number, at = int(given[wrong[0]]), line(int(wrong[0]))
        if number > total:
            raise ValueError(
                f"line {at}: a face has the vertex {number}, the file has {total}: it is cut off or damaged"
            )
        what = (
            "vertices are numbered from 1" if number == 0 else f"{before[lines.searchsorted(at)]} are before this line"
        )
        raise ValueError(f"line {at}: a face has the vertex {number}; {what}")
    return found
