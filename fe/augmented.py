"""What all contact by augmented Lagrangian shares: the multipliers between two load steps' rounds, and the bound."""

from __future__ import annotations

from typing import Any

import numpy as np


class Augmented:
    """State of a contact at its integration points.

    traction    [Pa] (p)    normal traction of the last evaluation, > 0 where they touch
    shear       [Pa] (p,3)  tangential traction of the last evaluation
    gap         [m]  (p)    negative where one body is in the other
    multiplier  [Pa] (p)    the normal traction that the next round starts from; sliding: the same of the shear
    bound       [m]         deepest penetration that is accepted
    """

    traction: np.ndarray
    shear: np.ndarray
    gap: np.ndarray
    multiplier: np.ndarray
    sliding: np.ndarray
    bound: float

    def settle(self) -> bool:
        """Whether the penetration is below the bound; if not, raise the multipliers."""
        self.multiplier = self.traction.copy()
        self.sliding = self.shear.copy()
        touching = self.traction > 0.0
        return not touching.any() or float(-self.gap[touching].min()) <= self.bound

    def state(self) -> dict[str, Any]:
        """What `restore` needs."""
        return {"multiplier": self.multiplier, "sliding": self.sliding}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a saved state."""
        self.multiplier, self.sliding = np.array(state["multiplier"]), np.array(state["sliding"])
