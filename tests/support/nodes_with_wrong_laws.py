"""A body whose terminal law leaves its range."""

import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base import Node


class Bouncy(Node):
    """Sends a negative stiffness from its 20th step on."""

    def start(self) -> None:
        self.steps = 0

    def step(self, load: Load) -> Surface:
        self.steps += 1
        stiffness = 3e3 if self.steps < 20 else -5.0
        return Surface(
            nodes=[],
            displacement=np.zeros((0, 3)),
            stiffness=stiffness,
            exponent=1.5,
            damping=5.0,
            rest_indentation=0.0,
            previous_indentation=0.0,
        )
