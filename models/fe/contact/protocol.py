"""What the solver needs of a contact or support: `fe.Rigid`, `fe.Pair`, `fe.bed.Bed`, or an own class."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from palpate.models.fe.contact.switching import Switching
from palpate.models.fe.sparse.pattern import Pattern


class ContactPair(Protocol):
    """Calls in their order: `bind` once; `begin`, `couples` and `couple` at each load step; `add`, `skew`,
    `switching`, `foresee`, `deep` and `settle` in its iterations; `leapt` at its end; `back` where it fails."""

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Make the state for a mesh (N,3) whose nodes have this stiffness [N/m] (N,)."""

    def couple(self, pattern: Pattern) -> None:
        """Take up a new pattern."""

    def couples(self) -> np.ndarray:
        """Nodes that are coupled beyond the elements (C,k), -1 fills up."""

    def nodes(self) -> np.ndarray:
        """Nodes that may be held."""

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Start of a load step from a converged state."""

    def back(self) -> None:
        """Forget a load step that failed."""

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """Add to the residual [N] (N,3) and, if asked, to the tangent's blocks [N/m] (B,3,3), symmetric."""

    def switching(self) -> Switching | None:
        """Its points, linearised about the last evaluation; None if the active set is kept within a step."""

    def foresee(self, traction: np.ndarray) -> None:
        """Tractions [Pa] (P,) that a step gave the points of `switching`."""

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:
        """Add the product of a change of displacement (N,3) with what `add` leaves out of the tangent."""

    def touches(self) -> bool:
        """Whether it carried a force at the last evaluation."""

    def deep(self) -> bool:
        """Whether the penetration is above its bound."""

    def settle(self) -> None:
        """Take the tractions as multipliers of the next round."""

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """Why a step between two loads and their displacements (N,3) was too long, empty where it was not."""

    def state(self) -> dict[str, Any]:
        """What `restore` needs."""

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a saved state."""


class Linkage:
    """A part of the body that is no element, for `fe.Solver` among its contacts. Unless it says so it is always there:
    it couples no more nodes than the elements do, has no active set, no penetration and no state."""

    def couples(self) -> np.ndarray:
        """None beyond those of the elements."""
        return np.zeros((0, 6), dtype=np.int64)

    def touches(self) -> bool:
        """Always."""
        return True

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Nothing to remember."""

    def back(self) -> None:
        """Nothing to forget."""

    def switching(self) -> Switching | None:
        """None: the active set is kept within a step."""
        return None

    def foresee(self, traction: np.ndarray) -> None:
        """Never called without `switching`."""

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
