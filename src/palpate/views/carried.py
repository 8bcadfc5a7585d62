"""Where an organ that moves is shown: x -> R x + t of the points of its frame, from its Support."""

from typing import NamedTuple

import numpy as np

from palpate.messages import Vector3
from palpate.messages.tissue import Support
from palpate.nodes.base.surface import rotation_matrix


class Carried(NamedTuple):
    """Displacement t [m] (3), and R (9) row by row; () if the organ does not rotate."""

    way: Vector3
    turn: tuple[float, ...] = ()

    @classmethod
    def by(cls, support: Support) -> "Carried":
        """The motion of an organ."""
        x, y, z = support.displacement
        if not support.rotation.any():
            return cls((x, y, z))
        a, b, c = support.rotation.tolist()
        turn = rotation_matrix((a, b, c))
        dx, dy, dz = (support.centre - turn @ support.centre).tolist()
        return cls((x + dx, y + dy, z + dz), tuple(turn.ravel().tolist()))

    def vectors(self, given: np.ndarray) -> np.ndarray:
        """Directions or displacements (...,3) of the organ's frame in the world."""
        return given @ np.reshape(self.turn, (3, 3)).T if self.turn else given

    def points(self, given: np.ndarray) -> np.ndarray:
        """Points [m] (...,3) of the organ's frame in the world."""
        return self.vectors(given) + self.way


STILL = Carried((0.0, 0.0, 0.0))
