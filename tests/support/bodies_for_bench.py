"""Custom bodies for `palpate bench accuracy`: a valid one, and three that fail."""

import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base import Node

NO_NODES, NO_VECTORS = np.zeros(0, dtype=np.int32), np.zeros((0, 3))


class Spring(Node):
    """A straight spring of 300 N/m."""

    def start(self) -> None:
        self.before = 0.0

    def step(self, load: Load, *, dt: float) -> Surface:
        self.before = -float(load.forces[:, 2].sum()) / 300.0
        return Surface(nodes=NO_NODES, displacement=NO_VECTORS, stiffness=300.0, exponent=1.0, damping=0.0,
                       rest_indentation=0.0, previous_indentation=self.before, step=dt)  # fmt: skip


class Raises(Spring):
    """Raises under load."""

    def step(self, load: Load, *, dt: float) -> Surface:
        if len(load.nodes):
            raise RuntimeError("no convergence in 40 iterations")
        return super().step(load, dt=dt)


class Drifts(Spring):
    """Sends an indentation that is NaN."""

    def step(self, load: Load, *, dt: float) -> Surface:
        printed = super().step(load, dt=dt)
        return Surface(nodes=NO_NODES, displacement=NO_VECTORS, stiffness=printed.stiffness, exponent=1.0, damping=0.0,
                       rest_indentation=0.0, previous_indentation=float("nan"), step=dt,
                       ) if len(load.nodes) else printed  # fmt: skip
