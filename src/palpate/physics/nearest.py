"""The nearest of many points, with the same result on all processors."""

from typing import Any

import numpy as np
import scipy  # loads its submodules when they are used

SPARE = 8  # More neighbours than asked for: where several are equally far, as on a regular mesh, their indices decide
SAME = 1e-9  # [1] of a distance, within which another one is equal


def tree_of(points: np.ndarray) -> Any:
    """The k-d tree of points (n,3) that `nearest` searches."""
    return scipy.spatial.cKDTree(points)


def nearest(tree: Any, places: np.ndarray, count: int = 1, most: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] (...,count) and indices (...,count) of the points nearest to each of `places` [m] (...,3).

    In ascending order; of equally distant points those with the lowest indices. scipy's distances, and its order of
    these points, depend on the processor, so both are computed here.

    most  [m] beyond which a distance is inf, with any index, and found in less time
    """
    *shape, size = np.shape(places)
    flat = np.reshape(places, (-1, size))
    away, found, clear = _nearest(tree, flat, count, count + 1, most)
    if not clear.all():
        away[~clear], found[~clear], _ = _nearest(tree, flat[~clear], count, count + SPARE, most)
    return away.reshape(*shape, away.shape[1]), found.reshape(*shape, away.shape[1])


def _nearest(
    tree: Any, places: np.ndarray, count: int, wanted: int, most: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`nearest` of places (n,3) among the `wanted` nearest points, and whether all of these are at other distances or
    there are no more of them (n,)."""
    wanted = min(wanted, tree.n)
    given, found = (each.reshape(len(places), wanted) for each in tree.query(places, wanted, distance_upper_bound=most))
    clear = (
        (given[:, -1] == np.inf) | (given[:, -1] > given[:, min(count, wanted) - 1] * (1.0 + SAME)) | (wanted == tree.n)
    )
    found = np.sort(found, axis=-1)
    missing = found == tree.n
    found[missing] = 0
    away = np.sqrt(np.sum(np.square(tree.data[found] - places[:, None, :]), axis=-1))
    away[missing] = np.inf
    order = np.argsort(away, axis=-1, kind="stable")[:, :count]
    return np.take_along_axis(away, order, -1), np.take_along_axis(found, order, -1), clear
