"""Reading a user's triangle mesh: STL (binary or text), PLY, OBJ."""

import json
import math
from functools import lru_cache
from hashlib import file_digest
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # imports its slow submodules at their first use

from palpate.nodes.base import SettingError
from palpate.nodes.base.mesh_formats import AGAIN, LARGEST_FILE, read_file
from palpate.nodes.base.stored.surfaces import stored
from palpate.physics.geometry.crossing import UncheckedError, crossing
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.pieces import pieces
from palpate.physics.geometry.search.corners import weld
from palpate.physics.geometry.topology import FLAT, edge_counts, one_sided, outward
from palpate.units.header import factor

LEAST_AREA = 1e-9  # [1] least total area over the square of the longest side
NEAR = 1e-6
"""[1] Distance over the longest side within which vertices at open edges are merged; STL rounds numbers to 6e-8."""
UNITS = {unit: factor(unit, "m") for unit in ("m", "cm", "mm")}  # those that a message proposes; every length is read
SMALLEST, LARGEST = 2e-3, 1.0
"""[m] Limits of the longest side of a touched object; outside them the unit is assumed to be wrong."""
ISLAND = 0.01
"""[1] Area of a separate piece over that of the largest one below which it is an island, such as a speck of a
segmentation, and left out; a vessel of 6 mm next to a liver has 5 %."""
NOTED_ROUNDING = 1e-4
"""[1] Steps of the coordinates over the longest side above which a note reports them: 0.02 mm of 200 mm."""
COINCIDE = 1e-3  # [1] Difference of the bounds of two pieces, over the size, up to which they lie at the same place
SHOWN = 8  # number of pieces that a message lists
REPAIR = "`palpate run kidney --organ {} --repair`"
NAME = "\0"  # the place of the file's name in stored flaws


class Triangles(NamedTuple):
    """The content of a file, cleaned: vertices (V,3) in its unit, triangles (T,3) int32, notes on what was changed, and
    whether the file may be cut off, as a clause."""

    vertices: np.ndarray
    triangles: np.ndarray
    notes: tuple[str, ...]
    cut: str


def read_mesh(path: str, scale: float, piece: int = 0) -> Mesh:
    """The mesh of a file; `scale`: its unit [m].

    Equal vertices (an STL file repeats them) and vertices at open edges nearer than `NEAR` are merged. Degenerate and
    repeated triangles and unused vertices are removed. Triangles are oriented outwards (`topology.outward`); those of
    an open sheet like most of them.

    piece  0: all separate pieces but islands (`ISLAND`); -1: all; k: the k-th largest, from 1

    SettingError: the file is missing or not a mesh, no triangles, no area, an implausible size, edges of more than two
    triangles, a one-sided surface, no such piece, two pieces at the same place.
    """
    vertices, triangles = read_triangles(path, piece)
    _plausible(path, vertices, scale)
    vertices = vertices * scale
    if not Mesh(vertices, triangles).areas.sum() > LEAST_AREA * float(np.ptp(vertices, axis=0).max()) ** 2:
        raise SettingError(
            f"setting 'surface': {path} has no area: its {len(triangles)} triangles are lines. Expected a surface; it "
            "may have lost a coordinate when it was written."
        )
    _, shared = edge_counts(triangles, len(vertices))
    if shared:
        edges = "1 edge" if shared == 1 else f"{shared} edges"
        raise SettingError(
            f"setting 'surface': {path} has {edges} that more than two triangles share{_shared_in(triangles)}: "
            f"it has no inside. {REPAIR.format(path)} rebuilds its surface."
        )
    right = _right(path, piece, *_stamp(path))
    if one_sided(right):
        raise SettingError(
            f"setting 'surface': {path} is one-sided, like a Möbius strip: its triangles cannot all face outwards, so "
            "it has no inside. Close or cut it in a mesh editor"
        )
    return Mesh(vertices, right)


def read_triangles(path: str, piece: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V,3) in the file's unit and triangles (T,3) int32, merged and cleaned as in `read_mesh`.

    The orientation of triangles is that of the file. SettingError: the file is missing or not a mesh, no triangles.
    """
    found = _read(path, piece)
    return found.vertices, found.triangles


def across(path: str, piece: int = 0) -> float:
    """Longest side of the file's mesh, in its unit. SettingError: it cannot be read."""
    return float(np.ptp(_read(path, piece).vertices, axis=0).max())


def _read(path: str, piece: int) -> Triangles:
    """As `read_triangles`, with notes."""
    return _read_once(path, piece, *_stamp(path))


def _stamp(path: str) -> tuple[object, ...]:
    """What changes with the content of a file: the results of reading it are kept until then."""
    file = Path(path).expanduser()
    if not file.is_file() or file.stat().st_size > LARGEST_FILE:
        return (str(Path.cwd()),)
    with file.open("rb") as stream:
        return str(Path.cwd()), file_digest(stream, "blake2b").digest()


@lru_cache(maxsize=2)
def _read_once(path: str, piece: int, *stamp: object) -> Triangles:
    """`_read` of the file with this stamp."""
    vertices, triangles, notes, cut = read_file(path)
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).any(axis=1).argmax())
        raise SettingError(
            f"setting 'surface': {path} contains a vertex that is not a finite number: vertex {bad + 1} is "
            f"({', '.join(f'{x:g}' for x in vertices[bad])}). {AGAIN}"
        )
    whole = _whole(weld(vertices)[triangles])
    if not len(whole):
        raise SettingError(f"setting 'surface': {path}: every triangle is a point or a line. {AGAIN}")
    triangles = _distinct(whole)
    if repeated := len(whole) - len(triangles):
        notes.append(f"{repeated} of its {len(whole)} triangles repeat another one and are left out")
    if (step := _rounding(vertices)) > NOTED_ROUNDING * float(np.ptp(vertices[np.unique(triangles)], axis=0).max()):
        notes.append(
            f"it lies up to {np.abs(vertices).max():.2g} from its origin, where its 32-bit numbers are rounded to steps"
            f" of {step:.2g}, in its unit. Move it to its origin before it is exported"
        )
    same = _near(vertices, triangles)
    merged = int((same != np.arange(len(vertices))).sum())
    if merged:
        triangles = _distinct(same[triangles])
        notes.append(f"{merged} vertices at open edges are merged with one within {NEAR:g} of its longest side")
    triangles, more = _choose_pieces(path, vertices, triangles, piece)
    used, triangles = np.unique(triangles, return_inverse=True)
    found = vertices[used], triangles.reshape(-1, 3).astype(np.int32)
    for array in found:
        array.flags.writeable = False
    return Triangles(*found, (*notes, *more), cut)


def _choose_pieces(path: str, vertices: np.ndarray, triangles: np.ndarray, piece: int) -> tuple[np.ndarray, list[str]]:
    """The triangles of the chosen pieces, and notes on the others. SettingError: no such piece, or two coincide."""
    label = pieces(triangles, len(vertices))
    count = int(label.max()) + 1
    if count == 1 and piece <= 1:
        return triangles, []
    area = np.bincount(label, np.linalg.norm(Mesh(vertices, triangles).face_vectors, axis=1))
    order = np.argsort(-area, kind="stable")
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    rank = rank[label]
    corners = [vertices[triangles[rank == k]].reshape(-1, 3) for k in range(min(count, SHOWN))]
    low, high = (np.array([end(each, axis=0) for each in corners]) for end in (np.min, np.max))
    listed = [f"{k + 1}: {_sides(high[k] - low[k])}" for k in range(len(low))]
    listed += [f"and {count - SHOWN} more"] * (count > SHOWN)
    text = f"{count} separate pieces ({'; '.join(listed)} in its unit)"
    if piece > count:
        raise SettingError(f"setting 'piece': found {piece}, expected 1 to {count}: {path} has {text}")
    if piece > 0:
        return triangles[rank == piece - 1], [f"it has {text}; piece {piece} is used"]
    islands = area[order] < ISLAND * area.max() if piece == 0 else np.zeros(count, dtype=bool)
    size = float((high - low).max())
    for k in range(1, min(len(low), int((~islands).sum()))):
        away = np.maximum(np.abs(low[:k] - low[k]), np.abs(high[:k] - high[k])).max(axis=1)
        if (away < COINCIDE * size).any() and abs(area[order[k]] / area[order[int(away.argmin())]] - 1.0) < 0.02:
            raise SettingError(
                f"setting 'surface': the pieces {int(away.argmin()) + 1} and {k + 1} of {path} lie at the same place: "
                f"nothing is between them. Use one of them: --piece {k + 1}, or piece: {k + 1} in the scene"
            )
    if not islands.any():
        return triangles, [f"it has {text}; all are used, --piece 1 uses only the largest"]
    share = 100 * area[order][islands].sum() / area.sum()
    return triangles[~islands[rank]], [
        f"it has {text}; {islands.sum()} with less than {ISLAND:.0%} of the area of the largest, together {share:.2g} %"
        " of the area, are left out as islands. --piece all keeps them"
    ]


def _sides(sides: np.ndarray) -> str:
    return " x ".join(f"{side:.3g}" for side in sides)


def _shared_in(triangles: np.ndarray) -> str:
    """Which pieces have edges that more than two triangles share, if there are several pieces."""
    label = pieces(triangles, int(triangles.max()) + 1)
    size = int(triangles.max()) + 1
    bad = sum(edge_counts(triangles[label == k], size)[1] > 0 for k in range(min(int(label.max()) + 1, SHOWN)))
    return f" (in {bad} of its {label.max() + 1} pieces; --piece K uses the K-th largest)" if label.max() else ""


def _near(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Index (V,) of the vertex with which each is merged: the first of those at open edges nearer than `NEAR`."""
    border = Mesh(vertices, triangles).border
    same = np.arange(len(vertices))
    if len(border):
        size = float(np.ptp(vertices[np.unique(triangles)], axis=0).max())
        pairs = scipy.spatial.cKDTree(vertices[border]).query_pairs(NEAR * size, output_type="ndarray")
        links = scipy.sparse.csr_array((np.ones(len(pairs)), pairs.T), shape=(len(border), len(border)))
        _, group = scipy.sparse.csgraph.connected_components(links, directed=False)
        _, first = np.unique(group, return_index=True)
        same[border] = border[first[group]]
    return same


@lru_cache(maxsize=2)
def _right(path: str, piece: int, *stamp: object) -> np.ndarray:
    """The triangles (T,3) of the file with this stamp, oriented by `outward`."""
    found = _read_once(path, piece, *stamp)
    return outward(found.vertices, found.triangles)


def flaws(path: str, piece: int = 0) -> list[str]:
    """Flaws of a mesh file that can still be used, one line each: pieces, open, inside out, self-intersecting. They are
    stored by the content of the file.

    SettingError: it cannot be read.
    """
    return [line.replace(NAME, path) for line in _flaws(path, piece, *_stamp(path))]


@lru_cache(maxsize=2)
def _flaws(path: str, piece: int, *stamp: object) -> list[str]:
    """`flaws` of the file with this stamp, with `NAME` in place of its path."""

    def made() -> list[str]:
        return _find_flaws(_read_once(path, piece, *stamp), _right(path, piece, *stamp))

    def arrays() -> dict[str, np.ndarray]:
        return {"lines": np.array(json.dumps(made()))}

    *_, digest = stamp
    if not isinstance(digest, bytes):  # a file that cannot be read
        return made()
    inputs = {"file": digest.hex(), "type": Path(path).suffix.lower(), "piece": piece}
    arrays_found = stored("flaws", inputs, arrays, f"{Path(path).name}, search for flaws")
    return list(json.loads(str(arrays_found["lines"])))


def _find_flaws(given: Triangles, right: np.ndarray) -> list[str]:
    """`_flaws` of a file with these triangles, which `outward` orients like that."""
    vertices, triangles, notes, cut = given
    border, _ = edge_counts(triangles, len(vertices))
    lines = [f"{NAME}: {note}." for note in notes]
    if border:
        areas = Mesh(vertices, right).face_vectors
        x, y, z = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        faces = f" It is a sheet that faces ({x:.2g}, {y:.2g}, {z:.2g}); touch it from there."
        lines.append(
            f"{NAME} is open: {border} edges have a triangle on one side only. A finger that goes beyond them meets "
            f"nothing, and deformation.ReducedFE needs a closed surface. {REPAIR.format(NAME)} closes it."
            + (f" If it should be closed: {cut}." if cut else "")
            + (faces if math.hypot(x, y, z) > FLAT else "")
        )
    turned = int((_least_first(right) != _least_first(triangles)).any(axis=1).sum())
    if turned == len(triangles):
        lines.append(f"{NAME} is inside out: all of its {turned} triangles face inwards. They are turned for this run.")
    elif turned:
        lines.append(
            f"{NAME} is partly inside out: {turned} of its {len(triangles)} triangles face the other way than the rest."
            " They are turned for this run."
        )
    try:
        through = crossing(vertices, triangles)
    except UncheckedError as error:
        through = None
        lines.append(f"{NAME}: it is not checked completely whether it intersects itself: it has {error}.")
    if through:
        x, y, z = through[2]
        lines.append(
            f"{NAME} intersects itself, first seen at ({x:.4g}, {y:.4g}, {z:.4g}) in the file's unit. The finger may "
            f"rest on a part that is inside. {REPAIR.format(NAME)} repairs it."
        )
    return lines


def _least_first(triangles: np.ndarray) -> np.ndarray:
    """The triangles, rotated so that each begins with its least corner; the orientation is kept."""
    start = triangles.argmin(axis=1)[:, None]
    return np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)


def _whole(triangles: np.ndarray) -> np.ndarray:
    """The triangles with three different corners."""
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _distinct(triangles: np.ndarray) -> np.ndarray:
    """The triangles with three different corners, those with the same corners once."""
    triangles = _whole(triangles)
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)]


def _rounding(vertices: np.ndarray) -> float:
    """Largest step between neighbouring numbers, if all are 32-bit numbers; else 0."""
    largest = float(np.abs(vertices).max())
    if largest > float(np.finfo(np.float32).max) or (vertices != vertices.astype(np.float32)).any():
        return 0.0
    return float(np.spacing(np.float32(largest)))


def plausible_units(across: float) -> list[str]:
    """Units in which this number is a plausible longest side of a touched object."""
    return [unit for unit, scale in UNITS.items() if SMALLEST <= across * scale <= LARGEST]


def _plausible(path: str, vertices: np.ndarray, scale: float) -> None:
    across = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST <= across * scale <= LARGEST:
        others = " or ".join(f"file_unit: {unit} ({across * UNITS[unit]:.3g} m)" for unit in plausible_units(across))
        raise SettingError(
            f"setting 'file_unit': {path} is {across * scale:.3g} m across, expected {SMALLEST:g} to {LARGEST:g} m. "
            + (f"Its numbers fit {others}." if others else "No unit fits its numbers.")
        )
