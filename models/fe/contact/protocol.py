"""What the solver needs of a contact or support: `fe.Rigid`, `fe.Pair`, `fe.bed.ElasticFoundation`, or an own class."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from palpate.models.fe.contact.switching import Switching
from palpate.models.fe.sparse.pattern import Pattern


class ContactPair(ABC):
    """Calls in their order: `bind` once; `begin`, `couples` and `couple` at each load step; `add`, `skew`,
    `switching`, `foresee`, `deep` and `settle` in its iterations; `leapt` at its end; `back` where it fails.

    Unless it says otherwise it is always there, like a support: it couples no more nodes than the elements do, has no
    active set, no penetration and no state.
    """

    @abstractmethod
    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Make the state for a mesh (N,3) whose nodes have this stiffness [N/m] (N,)."""

    @abstractmethod
    def couple(self, pattern: Pattern) -> None:
        """Take up a new pattern."""

    @abstractmethod
    def nodes(self) -> np.ndarray:
        """Nodes that may be held."""

    @abstractmethod
    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """Add to the residual [N] (N,3) and, if asked, to the tangent's blocks [N/m] (B,3,3), symmetric."""

    def couples(self) -> np.ndarray:
        """Nodes that are coupled beyond the elements (C,k), -1 fills up."""
        return np.zeros((0, 6), dtype=np.int64)

    def begin(self, displacement: np.ndarray, load: float) -> None:  # noqa: B027
        """Start of a load step from a converged state."""

    def back(self) -> None:  # noqa: B027
        """Forget a load step that failed."""

    def switching(self) -> Switching | None:
        """Its points, linearised about the last evaluation; None if the active set is kept within a step."""
        return None

    def foresee(self, traction: np.ndarray) -> None:  # noqa: B027
        """Tractions [Pa] (P,) that a step gave the points of `switching`."""

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:  # noqa: B027
        """Add the product of a change of displacement (N,3) with what `add` leaves out of the tangent."""

    def touches(self) -> bool:
        """Whether it carried a force at the last evaluation."""
        return True

    def deep(self) -> bool:
        """Whether the penetration is above its bound."""
        return False

    def settle(self) -> None:  # noqa: B027
        """Take the tractions as multipliers of the next round."""

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """Why a step between two loads and their displacements (N,3) was too long, empty where it was not."""
        return ""

    def state(self) -> dict[str, Any]:
        """What `restore` needs."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Go on from a saved state."""
