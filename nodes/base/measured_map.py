"""A measured map of stiffness: a file of `palpate fit map`, as a factor on the stiffness of each vertex."""

from pathlib import Path

import numpy as np

from palpate.nodes.base.node import SettingError
from palpate.physics.nearest import nearest, tree_of
from palpate.physics.table_file import read_table
from palpate.units.header import split_unit

COLUMNS = ("x", "y", "z", "factor")
LOWEST, HIGHEST = 1e-3, 1e3


def measured_factor(file: str, vertices: np.ndarray) -> np.ndarray:
    """Factor [1] (V) at vertices [m] (V,3): that of the nearest place of the file; 1 farther than two spacings from it.

    SettingError: the file cannot be read, or does not lie on the surface.
    """
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
    return np.where(near, rows[closest, 3], 1.0)
