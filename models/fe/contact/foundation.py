"""An elastic foundation under some faces: springs per area that resist displacement in all directions."""

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.sparse.pattern import Pattern


class ElasticFoundation(ContactPair):
    """Springs of a stiffness > 0 [Pa/m] between boundary faces (F,6) and their undeformed position; one of the contacts
    of an `fe.Solver`."""

    def __init__(self, faces: np.ndarray, stiffness: float) -> None:
        if not stiffness > 0:
            raise ValueError(f"elastic foundation: found {stiffness} Pa/m, expected a positive number")
        self.faces, self.stiffness = faces, stiffness

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        area = face_rule.areas(points, self.faces)
        self._block = self.stiffness * np.einsum("fq,qa,qb->fab", area, face_rule.VALUES, face_rule.VALUES)
        self.couple(pattern)

    def couple(self, pattern: Pattern) -> None:
        self._where = pattern.where(self.faces)

    def nodes(self) -> np.ndarray:
        """Nodes on which it acts (F,6)."""
        return self.faces

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        np.add.at(force, self.faces, np.einsum("fab,fbi->fai", self._block, displacement[self.faces]))
        if tangent:
            np.add.at(data, self._where, self._block[..., None, None] * np.eye(3))
