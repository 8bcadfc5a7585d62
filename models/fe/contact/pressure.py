"""Pressure of a contact as a field: continuous, linear over each face.

The tractions at the integration points are right in their sums and scatter from point to point. The field p that is
nearest to them in the mean square over the deformed faces,

    int v p da = int v t dA    for every continuous v that is linear over each face,

keeps the resultant and leaves the scatter: t is the traction at the integration points on undeformed area dA, da the
deformed one. Against Hertz's pressure its error in the mean square falls with the first power of the faces' size
(`benchmarks/fe_hertz.py`); beside the edge it may be a little below zero.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from palpate.models.fe.contact.augmented import Augmented
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.faces import HATS


def pressure(touch: Augmented, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the faces that may touch (V,), and the pressure there [Pa] (V,), at the solver's displacement [m]
    (N,3)."""
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
    """The same at every node of the mesh [Pa] (N,), zero off the faces, halfway between the corners on their edges: for
    files that hold fields on quadratic elements."""
    nodes, value = pressure(touch, displacement)
    pressures = np.zeros(len(displacement))
    pressures[nodes] = value
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        pressures[touch.faces[:, 3 + k]] = 0.5 * (pressures[touch.faces[:, i]] + pressures[touch.faces[:, j]])
    return pressures
