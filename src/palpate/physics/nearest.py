"""The nearest of many points, with the same result on all processors."""

from typing import Any

import numpy as np
import scipy  # loads its submodules when they are used

SPARE = 8  # More neighbours than asked for: where several are equally far, as on a regular mesh, their indices decide


def tree_of(points: np.ndarray) -> Any:
    """The k-d tree of points (n,3) that `nearest` searches."""
    return scipy.spatial.cKDTree(points)


def nearest(tree: Any, places: np.ndarray, count: int = 1, most: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] (...,count) and indices (...,count) of the points nearest to each of `places` [m] (...,3).

    In ascending order; of equally distant points those with the lowest indices. scipy's distances, and its order of
    these points, depend on the processor, so both are computed here.

    most  [m] beyond which a distance is inf, with any index, and found in less time
    """
    wanted = min(count + SPARE, tree.n)
    found = tree.query(places, k=wanted, distance_upper_bound=most)[1].reshape(*np.shape(places)[:-1], wanted)
    found = np.sort(found, axis=-1)
    missing = found == tree.n
    found[missing] = 0
    away = np.sqrt(np.sum(np.square(tree.data[found] - np.asarray(places)[..., None, :]), axis=-1))
    away[missing] = np.inf
    order = np.argsort(away, axis=-1, kind="stable")[..., :count]
    return np.take_along_axis(away, order, -1), np.take_along_axis(found, order, -1)
