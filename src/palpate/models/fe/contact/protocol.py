"""Interface of the solver to contacts and supports, such as `fe.RigidIndenter` and `fe.Pair`; an elastic foundation."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from palpate.models.fe.contact.switching import Switching
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.sparse.tangent import Pattern


class ContactPair(ABC):
    """Order of calls: `bind` once; `begin`, `couples` and `couple` at each load step; `add`, `skew`, `switching`,
    `foresee`, `deep` and `settle` in its iterations; `leapt` at its end; `back` if it fails.

    The defaults are those of a permanent support: no additional couplings, active set, penetration or state.

    faces  (F,6) on which it may act
    """

    faces: np.ndarray

    @abstractmethod
    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Initialise for a mesh with points [m] (N,3) and a stiffness [N/m] (N,) of each node."""

    @abstractmethod
    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """Add to the residual [N] (N,3) and, if `tangent`, to the blocks [N/m] (B,3,3) of the symmetric tangent."""

    def couple(self, pattern: Pattern) -> None:
        """Use a new sparsity pattern."""
        self._where = pattern.where(self.faces)

    def nodes(self) -> np.ndarray:
        """Nodes on which it may act."""
        return self.faces

    def couples(self) -> np.ndarray:
        """Nodes that are coupled in addition to the elements (C,k), padded with -1."""
        return np.zeros((0, 6), dtype=np.int64)

    def begin(self, displacement: np.ndarray, load: float) -> None:  # noqa: B027
        """Start a load step from a converged state."""

    def back(self) -> None:  # noqa: B027
        """Undo a failed load step."""

    def switching(self) -> Switching | None:
        """Its points, linearised about the last evaluation; None if the active set is constant within a step."""
        return None

    def foresee(self, traction: np.ndarray) -> None:  # noqa: B027
        """Use tractions [Pa] (P,) that a step predicted for the points of `switching`."""

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:  # noqa: B027
        """Add the product of a change of displacement (N,3) with the unsymmetric part of the tangent."""

    def touches(self) -> bool:
        """Whether it transmitted a force at the last evaluation."""
        return True

    def deep(self) -> bool:
        """Whether the penetration is above its bound."""
        return False

    def settle(self) -> None:  # noqa: B027
        """Update the multipliers with the tractions."""

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """Why a step between two loads and their displacements (N,3) was too long; "" if it was not."""
        return ""

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Continue from a saved state."""


class ElasticFoundation(ContactPair):
    """Springs of a stiffness > 0 [Pa/m], one or (F), between boundary faces (F,6) and their undeformed position; one of
    the contacts of an `fe.Solver`."""

    def __init__(self, faces: np.ndarray, stiffness: float | np.ndarray) -> None:
        if not np.all(np.asarray(stiffness) > 0):
            raise ValueError(f"elastic foundation: found {np.min(stiffness)} Pa/m, expected a positive number")
        self.faces, self.stiffness = faces, stiffness

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        area = face_rule.areas(points, self.faces)
        block = np.einsum("fq,qa,qb->fab", area, face_rule.VALUES, face_rule.VALUES)
        self._block = np.reshape(self.stiffness, (-1, 1, 1)) * block
        self.couple(pattern)

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        np.add.at(force, self.faces, np.einsum("fab,fbi->fai", self._block, displacement[self.faces]))
        if tangent:
            np.add.at(data, self._where, self._block[..., None, None] * np.eye(3))

    def inputs(self) -> bytes:
        """All that its forces depend on."""
        stiff = self.stiffness.tobytes() if isinstance(self.stiffness, np.ndarray) else repr(self.stiffness).encode()
        return stiff + np.ascontiguousarray(self.faces).tobytes()
