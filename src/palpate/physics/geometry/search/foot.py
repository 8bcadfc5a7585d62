"""The foot of a point on a surface, as a record that the searches on NURBS surfaces and on meshes fill."""

from collections.abc import Callable

import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Record

FOOT = {"point": (3,), "normal": (3,), "place": (2,), "distance": (), "triangle": int}
"""Foot point [m]; outward normal there [1]; u and v on a NURBS surface, the weights of the second and third corner on a
mesh [1]; signed distance of the point [m], positive outside; triangle of a mesh."""
FEET = element_type(FOOT)
"""The dtype of an array of feet."""


def find_feet(search: Callable[[np.ndarray, np.ndarray], None], points: np.ndarray) -> np.ndarray:
    """The feet (...) of points [m] (...,3). `search` fills the feet (n) of points (n,3)."""
    points = np.asarray(points, dtype=float)
    feet = np.zeros(points.shape[:-1], FEET)
    search(np.ascontiguousarray(points.reshape(-1, 3)), feet.reshape(-1))
    return feet


@kernel
def values_of(foot: Record):
    """The values of a foot, for `set_values`."""
    return vector(foot.point), vector(foot.normal), (foot.place[0], foot.place[1]), foot.distance, foot.triangle


@kernel
def set_values(foot: Record, values: tuple):
    """Set a foot to the result of `values_of`."""
    point, normal, place, foot.distance, foot.triangle = values
    put(foot.point, point)
    put(foot.normal, normal)
    foot.place[0], foot.place[1] = place
