"""Base of all augmented-Lagrangian contacts: settings, state, multipliers between two updates, friction, pressure."""

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from palpate.compiler.kernel import kernel
from palpate.models.fe.contact.area import contact_area
from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import point_text

STIFF = 10.0
"""Penalty over the stiffness per area of the faces. A 10 times larger one requires fewer updates of the multipliers but
more iterations with sliding points."""
SMOOTH = 10.0  # Factor on the penalty without friction, where there are no sliding points


class Augmented(ContactPair):
    """State of a contact at the integration points of the faces that may touch.

    traction    [Pa] (F,6)    normal traction of the last evaluation, > 0 in contact
    shear       [Pa] (F,6,3)  tangential traction of the last evaluation
    gap         [m]  (F,6)    negative for penetration, inf out of range
    normal      [1]  (F,6,3)  of the other body, in contact
    slip             (F,6)    bool, the point slides
    multiplier  [Pa] (F,6)    multiplier of the normal traction; sliding: that of the shear
    force       [N]  (3)      force on the faces
    bound       [m]           largest accepted penetration
    """

    def __init__(self, faces: np.ndarray, friction: float, bound: float, penalty: float) -> None:
        if not 0.0 <= friction < np.inf:
            raise ValueError(f"friction {friction}: expected a number >= 0")
        if not (0.0 <= bound < np.inf and 0.0 <= penalty < np.inf):
            raise ValueError(
                f"bound {bound} m, penalty {penalty} Pa/m: expected positive numbers, or 0 to choose them automatically"
            )
        self.faces = checked_faces(faces)
        self.friction, self.bound, self.penalty = float(friction), float(bound), float(penalty)
        self.value = face_rule.VALUES

    @property
    def traces(self) -> tuple[np.ndarray, ...]:
        return self.traction, self.shear, self.gap, self.normal, self.slip

    def clear(self, points: np.ndarray) -> None:
        """Initial state on a mesh with these points [m] (N,3)."""
        self.points = points
        self.area = face_rule.areas(points, self.faces)
        if not self.bound > 0.0:
            self.bound = self.edge / 2000.0
        size = self.area.shape
        self.multiplier, self.traction, self.gap = np.zeros(size), np.zeros(size), np.full(size, np.inf)
        self.sliding, self.shear, self.normal = (np.zeros((*size, 3)) for _ in range(3))
        self.slip = np.zeros(size, dtype=bool)
        self.force = np.zeros(3)
        self.remember()

    def touches(self) -> bool:
        return bool((self.traction > 0.0).any())

    @property
    def edge(self) -> float:
        """Mean edge of the faces [m]."""
        return float(np.sqrt(2.0 * self.area.sum() / len(self.faces)))

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """Description of the fault if the step ended with the other body pressing on the back of the faces, else ""."""
        outward = np.einsum("fqi,fqi->fq", self.normal, face_rule.normals(self.points + end, self.faces))
        behind = (self.traction > 0.0) & (outward > 0.0)
        if not behind.any():
            return ""
        f, q = np.unravel_index(int(np.argmax(np.where(behind, self.traction, 0.0))), behind.shape)
        at = self.value[q] @ self.points[self.faces[f]]
        return f"the other body passes through the surface at {point_text(at)} and presses on it from behind"

    def remember(self) -> None:
        """Save the multipliers, so that a failed load step can be undone."""
        self._saved = self.multiplier.copy(), self.sliding.copy()

    def back(self) -> None:
        self.multiplier, self.sliding = (x.copy() for x in self._saved)

    def deep(self) -> bool:
        touching = self.traction > 0.0
        return bool(touching.any()) and float(-self.gap[touching].min()) > self.bound

    def settle(self) -> None:
        self.multiplier = self.traction.copy()
        self.sliding = self.shear.copy()

    def friction_slope(self, pressed: np.ndarray) -> np.ndarray:
        """Change of -shear [Pa] (F,6,3) of sliding points when their gaps increase by `pressed` [m] (F,6)."""
        size = np.linalg.norm(self.shear, axis=2)
        rate = np.where(self.slip, self.friction * self.penalty * pressed, 0.0) / np.where(size > 0.0, size, 1.0)
        return rate[..., None] * self.shear

    def state(self) -> dict[str, Any]:
        return {"multiplier": self.multiplier, "sliding": self.sliding}

    def restore(self, state: dict[str, Any]) -> None:
        self.multiplier, self.sliding = np.array(state["multiplier"]), np.array(state["sliding"])

    def contact_area(self, displacement: np.ndarray) -> float:
        """Area of contact on the deformed faces [m²], see `fe.contact.area`."""
        return contact_area((self.points + displacement)[self.faces], self.gap, self.traction)

    def pressure(self, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corner nodes of the faces (V,), and the pressure there [Pa] (V,), linear over each face, at a displacement
        [m] (N,3).

        The tractions t at the integration points are correct in their sums but scatter. The L2 projection p onto the
        deformed faces,

            int v p da = int v t dA    for every continuous v that is linear over each face,

        with deformed areas da and undeformed areas dA, preserves the resultant and removes the scatter. Its RMS error
        relative to Hertz's pressure decreases linearly with the size of the faces (`benchmarks/fe_hertz.py`); near the
        edge p may be slightly negative.
        """
        nodes, index = np.unique(self.faces[:, :3], return_inverse=True)
        index = index.reshape(-1, 3)
        area = face_rule.areas(self.points + displacement, self.faces)
        mass = np.einsum("fq,qa,qb->fab", area, face_rule.HATS, face_rule.HATS)
        load = np.zeros(len(nodes))
        np.add.at(load, index, (self.traction * self.area) @ face_rule.HATS)
        row, column = np.broadcast_arrays(index[:, :, None], index[:, None, :])
        matrix = coo_array((mass.ravel(), (row.ravel(), column.ravel())), shape=(len(nodes),) * 2)
        return nodes, splu(matrix.tocsc()).solve(load)

    def nodal_pressure(self, displacement: np.ndarray) -> np.ndarray:
        """The pressure at all nodes of the mesh [Pa] (N,), zero outside the faces, linear along edges; for files with
        fields on quadratic elements."""
        nodes, value = self.pressure(displacement)
        pressures = np.zeros(len(displacement))
        pressures[nodes] = value
        for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
            pressures[self.faces[:, 3 + k]] = 0.5 * (pressures[self.faces[:, i]] + pressures[self.faces[:, j]])
        return pressures


def checked_faces(faces: np.ndarray) -> np.ndarray:
    """Faces (F,6) as a contiguous array. ValueError: none, or not six nodes each."""
    numbers = np.ascontiguousarray(faces, dtype=np.int64)
    if numbers.ndim != 2 or numbers.shape[1] != 6 or len(numbers) == 0:
        raise ValueError(f"faces: found shape {numbers.shape}, expected (F, 6) with F > 0, such as `TetMesh.faces`")
    return numbers


def stiffness_per_area(faces: np.ndarray, area: np.ndarray, stiffness: np.ndarray) -> float:
    """Stiffness per area [Pa/m] of faces with these areas [m²] (F,6), from the stiffness [N/m] (N,) of the nodes."""
    nodes = np.unique(faces)
    return float(np.median(stiffness[nodes])) * len(nodes) / float(area.sum())


@kernel
def cut_to_cone(q, normal, most, shear):
    """Coulomb's return map: removes the normal part of the trial traction q [Pa] (3) and fills `shear` [Pa] (3), q
    scaled to at most the length `most` [Pa]. Returns the scale, the length of q [Pa], and whether the point slips."""
    along = normal[0] * q[0] + normal[1] * q[1] + normal[2] * q[2]
    for i in range(3):
        q[i] -= along * normal[i]
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    slips = length > most
    cut = most / length if slips else 1.0
    for i in range(3):
        shear[i] = cut * q[i]
    return cut, length, slips


@kernel
def add_tangent(penalty, normal, q, cut, length, slips, block):
    """Add the tangent [Pa/m] of both tractions to `block` (3,3): penalty n x n, plus cut penalty (1 - n x n), minus
    q x q/|q|² in slip, for friction; cut = 0: no friction."""
    for i in range(3):
        for j in range(3):
            square = normal[i] * normal[j]
            block[i, j] += penalty * square
            if cut > 0.0:
                part = (1.0 if i == j else 0.0) - square
                if slips:
                    part -= q[i] * q[j] / (length * length)
                block[i, j] += penalty * cut * part
