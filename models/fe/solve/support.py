"""Check that fixed nodes or loaded contacts prevent rigid motion of every piece of a body."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element.mesh import TetMesh, point_text
from palpate.models.fe.sparse.pattern import Pattern

FIXED = 1e-12  # [1] Relative stiffness of a rigid motion above which fixed components prevent it; below is rounding
HELD = 1e-8  # [1] The same for contacts; a contact of 0.1 % of the size of the body still prevents rotation
CARRIED = 1e-11  # [1] Force of the contacts over stiffness times size of the body, below which they are unloaded


def pieces(mesh: TetMesh) -> np.ndarray:
    """Number of the connected piece to which each node belongs (N,)."""
    many = mesh.elements.shape[1]
    first = np.repeat(mesh.elements[:, 0], many)
    size = (len(mesh.points),) * 2
    links = coo_array((np.ones(len(first), dtype=np.int8), (first, mesh.elements.ravel())), shape=size)
    return connected_components(links, directed=False)[1]


class Support:
    """Rigid motions of the pieces of a mesh that the fixed components (N,3) bool leave free."""

    def __init__(self, mesh: TetMesh, fixed: np.ndarray) -> None:
        self.mesh, self._piece = mesh, pieces(mesh)
        motions = []
        for piece in np.unique(self._piece[mesh.elements[:, 0]]).tolist():
            rigid = _rigid(mesh.points, self._piece == piece)
            held = rigid[fixed]
            value, vector = np.linalg.eigh(held.T @ held)
            motions.append(rigid @ vector[:, value <= FIXED * max(value[-1], 1.0)])
        self.free = np.concatenate(motions, axis=2).reshape(mesh.points.size, -1)  # Displacements (3N,k), at most 1

    def adrift(self, u: np.ndarray, load: float, contacts: Sequence[ContactPair], pattern: Pattern) -> str:
        """Description of a rigid motion without resistance of a body in equilibrium, or "".

        Contacts prevent a motion if they carry a force and their stiffness against it is positive.
        """
        if not self.free.shape[1]:
            return ""
        force, data = np.zeros_like(u), np.zeros((len(pattern.indices), 3, 3))
        for contact in contacts:
            contact.add(u, load, True, force, data)
        matrix = pattern.matrix(data)
        stiffness = float(np.abs(matrix.diagonal()).sum())
        value, vector = np.linalg.eigh(self.free.T @ (matrix @ self.free))
        carried = np.linalg.norm(force) > CARRIED * stiffness * self.mesh.size
        if carried and value[0] > HELD * stiffness:
            return ""
        return self._described((self.free @ vector[:, 0]).reshape(-1, 3), bool(carried))

    def _described(self, motion: np.ndarray, carried: bool) -> str:
        piece = self._piece[np.argmax(np.linalg.norm(motion, axis=1))]
        elements = self.mesh.elements[self._piece[self.mesh.elements[:, 0]] == piece]
        rigid = _rigid(self.mesh.points, self._piece == piece).reshape(motion.size, 6)
        part = np.linalg.lstsq(rigid, motion.ravel())[0]
        shift, turn = part[:3], part[3:]
        straight = np.linalg.norm(shift) >= np.linalg.norm(turn)
        along = np.round((shift if straight else turn) / np.linalg.norm(shift if straight else turn), 2) + 0.0
        goes = f"{'moving along' if straight else 'turning about'} ({along[0]:g}, {along[1]:g}, {along[2]:g})"
        why = "its contacts carry a force, but not against this" if carried else "no contact carries a force"
        at = point_text(self.mesh.points[elements[:, :4]].mean(axis=(0, 1)))
        return (
            f"nothing holds the piece of {len(elements)} elements around {at} against {goes}: {why}. Fix some of its "
            "nodes, support it with an `ElasticFoundation` (palpate.models.fe.contact.foundation), or press it from "
            "all sides, with friction where it may slide"
        )


def _rigid(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Rigid motions (N,3,6) of the nodes (N,) bool: three translations, three rotations about their mean position.

    Displacements are at most 1, and 0 at the other nodes.
    """
    arm = points - points[nodes].mean(axis=0)
    arm /= np.linalg.norm(arm[nodes], axis=1).max()
    motions = np.zeros((*points.shape, 6))
    for k, axis in enumerate(np.eye(3)):
        motions[nodes, :, k] = axis
        motions[nodes, :, 3 + k] = np.cross(axis, arm[nodes])
    return motions
