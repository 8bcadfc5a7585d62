"""A measured map of stiffness: a file of `palpate fit map`, as a factor on the stiffness of each vertex."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.nodes.base.node import SettingError
from palpate.physics.nearest import nearest, tree_of
from palpate.physics.table_file import read_table
from palpate.units.header import split_unit

COLUMNS = ("x", "y", "z", "factor")
LOWEST, HIGHEST = 1e-3, 1e3


class MeasuredMap(NamedTuple):
    """Factors [1] (p) of the places of a file, and the place of each vertex (V): the nearest one, -1 farther than two
    spacings from it."""

    factors: np.ndarray
    place: np.ndarray


def measured_factor(file: str, vertices: np.ndarray, factors: Sequence[float] = ()) -> np.ndarray:
    """Factor [1] (V) at vertices [m] (V,3): that of the place of each, 1 without one.

    factors  of the places, in the order of the file, instead of those of the file

    SettingError: the file cannot be read, or does not lie on the surface; the factors are not those of its places.
    """
    found = read_map(file, vertices)
    if len(factors) not in (0, len(found.factors)):
        raise SettingError(f"setting 'map_factors': found {len(factors)} factors, expected {len(found.factors)}, one "
                           f"for each place of {file}")  # fmt: skip
    wrong = [each for each in factors if not LOWEST <= each <= HIGHEST]
    if wrong:
        raise SettingError(f"setting 'map_factors': found {wrong[0]:g}, expected {LOWEST:g} to {HIGHEST:g}")
    values = np.asarray(factors, float) if len(factors) else found.factors
    return np.where(found.place >= 0, values[found.place], 1.0)


def read_map(file: str, vertices: np.ndarray) -> MeasuredMap:
    """The map of a file at vertices [m] (V,3). SettingError: it cannot be read, or does not lie on the surface."""
    try:
        now = Path(file).stat()
    except OSError as error:
        raise SettingError(f"setting 'measured_map': {file}: {error.strerror}") from None
    return _read_map(file, (now.st_mtime_ns, now.st_size), vertices.tobytes())


@lru_cache(maxsize=2)
def _read_map(file: str, stamp: tuple[int, int], data: bytes) -> MeasuredMap:
    """`read_map`, kept because hundreds of lanes differ only in the factors of one map.

    stamp  of the file: time of its last change and size
    """
    vertices = np.frombuffer(data).reshape(-1, 3)
    try:
        table = read_table(Path(file), lambda cells: sum(split_unit(cell)[0] in COLUMNS for cell in cells), 4)
        names = table.names
        if missing := [name for name in COLUMNS if name not in names]:
            raise ValueError(f"found the columns {', '.join(names)}; expected {', '.join(missing)} too")
        columns = [names.index(name) for name in COLUMNS]
        factors = [table.factor(k, "m") or 1.0 for k in columns[:3]]
        rows, lines = table.values(columns)
        rows[:, :3] *= factors
    except (OSError, ValueError) as error:
        raise SettingError(f"setting 'measured_map': {file}: {getattr(error, 'strerror', None) or error}") from None
    if len(rows) < 4:
        raise SettingError(f"setting 'measured_map': {file}: found {len(rows)} places, expected at least 4")
    wrong = np.flatnonzero((rows[:, 3] < LOWEST) | (rows[:, 3] > HIGHEST))
    if len(wrong):
        raise SettingError(f"setting 'measured_map': {file}, row {lines[wrong[0]]}: found the factor "
                           f"{rows[wrong[0], 3]:g}, expected {LOWEST:g} to {HIGHEST:g}")  # fmt: skip
    tree = tree_of(rows[:, :3])
    spacing, edge = (float(np.median(nearest(t, t.data, 2)[0][:, 1])) for t in (tree, tree_of(vertices)))
    apart, closest = (each[:, 0] for each in nearest(tree, vertices))
    near = apart < 2.0 * max(spacing, edge)
    if not near.any():
        raise SettingError(f"setting 'measured_map': {file}: its places lie {1e3 * apart.min():.3g} mm and more from "
                           "the surface; expected the frame of the surface")  # fmt: skip
    return MeasuredMap(rows[:, 3], np.where(near, closest, -1))
