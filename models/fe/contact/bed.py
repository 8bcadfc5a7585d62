"""An elastic bed under some faces: a spring per area that resists displacement in all directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.models.fe.contact.switching import Switching
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.sparse.pattern import Pattern


class ElasticFoundation:
    """Springs between faces and their undeformed position, for `fe.Solver` among its contacts.

    faces      (F,6) boundary faces that lie on the bed
    stiffness  [Pa/m] > 0
    """

    def __init__(self, faces: np.ndarray, stiffness: float) -> None:
        if not stiffness > 0:
            raise ValueError(f"bed: found {stiffness} Pa/m, expected a positive number")
        self.faces, self.stiffness = faces, stiffness
        self._value, _ = face_rule.shape(face_rule.POINTS)

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Make the springs for a mesh."""
        area = face_rule.areas(points, self.faces)
        self._block = self.stiffness * np.einsum("fq,qa,qb->fab", area, self._value, self._value)
        self.couple(pattern)

    def couple(self, pattern: Pattern) -> None:
        """Take up a new pattern."""
        self._where = pattern.where(self.faces)

    def couples(self) -> np.ndarray:
        """No nodes beyond those of the elements."""
        return np.zeros((0, 6), dtype=np.int64)

    def nodes(self) -> np.ndarray:
        """Nodes that it holds (F,6)."""
        return self.faces

    def touches(self) -> bool:
        """Always."""
        return True

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Nothing to remember."""

    def back(self) -> None:
        """Nothing to forget."""

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """Add the springs to the residual (N,3) and, if asked, to the tangent's blocks."""
        np.add.at(force, self.faces, np.einsum("fab,fbi->fai", self._block, displacement[self.faces]))
        if tangent:
            np.add.at(data, self._where, self._block[..., None, None] * np.eye(3))

    def switching(self) -> Switching | None:
        """None: springs never part."""
        return None

    def foresee(self, traction: np.ndarray) -> None:
        """Never called, as there is no active set."""

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:
        """Nothing is left out of the tangent."""

    def deep(self) -> bool:
        """Never."""
        return False

    def settle(self) -> None:
        """Nothing to raise."""

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """Never."""
        return ""

    def state(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Nothing."""
