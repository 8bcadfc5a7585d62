"""Pressure of a contact as a continuous field, linear over each face.

The tractions t at the integration points are correct in their sums but scatter. The L2 projection p onto the deformed
faces,

    int v p da = int v t dA    for every continuous v that is linear over each face,

with deformed areas da and undeformed areas dA, preserves the resultant and removes the scatter. Its RMS error relative
to Hertz's pressure decreases linearly with the size of the faces (`benchmarks/fe_hertz.py`); near the edge p may be
slightly negative.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from palpate.models.fe.contact.augmented import Augmented
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.faces import HATS


def pressure(touch: Augmented, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corner nodes of the faces that may touch (V,), and the pressure there [Pa] (V,), at a displacement [m] (N,3)."""
    nodes, index = np.unique(touch.faces[:, :3], return_inverse=True)
    index = index.reshape(-1, 3)
    area = face_rule.areas(touch.points + displacement, touch.faces)
    mass = np.einsum("fq,qa,qb->fab", area, HATS, HATS)
    load = np.zeros(len(nodes))
    np.add.at(load, index, (touch.traction * touch.area) @ HATS)
    row, column = np.broadcast_arrays(index[:, :, None], index[:, None, :])
    matrix = coo_array((mass.ravel(), (row.ravel(), column.ravel())), shape=(len(nodes),) * 2)
    return nodes, splu(matrix.tocsc()).solve(load)


def nodal_pressure(touch: Augmented, displacement: np.ndarray) -> np.ndarray:
    """The pressure at all nodes of the mesh [Pa] (N,), zero outside the faces, linear along edges; for files with
    fields on quadratic elements."""
    nodes, value = pressure(touch, displacement)
    pressures = np.zeros(len(displacement))
    pressures[nodes] = value
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        pressures[touch.faces[:, 3 + k]] = 0.5 * (pressures[touch.faces[:, i]] + pressures[touch.faces[:, j]])
    return pressures
