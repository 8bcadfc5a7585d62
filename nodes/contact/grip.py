"""How several fingers hold one body."""

import math
from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load
from palpate.messages.grip import Grip as GripMessage
from palpate.nodes.base import Node
from palpate.physics.contact.grip import grip_force
from palpate.physics.entry_point import entry_point


class Grip(Node):
    """Grip force, load force and safety margins of fingers that press on one body (docs/equations/contact.md).

    Each load is what one finger does to the body, at its foot point. A finger without a sender presses with nothing.
    `mu_static` is the coefficient at which a finger that sticks begins to slip: the friction law's own.
    """

    mu_static: Annotated[float, "1", msgspec.Meta(gt=0)] = 0.7

    def start(self) -> None:
        self._grip = entry_point(grip_force, np.zeros((2, 3)), np.zeros((2, 3)))

    def step(self, load: list[Load | None]) -> GripMessage:
        count = len(load)
        foot, forces, normals = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
        for i, one in enumerate(load):
            if one is not None and len(one.nodes):
                foot[i], normals[i] = one.foot, one.normal
                forces[i] = one.forces.sum(axis=0)
        normal = -(forces * normals).sum(axis=1)
        rubbed = forces + normal[:, None] * normals
        tangential = np.sqrt((rubbed * rubbed).sum(axis=1))
        presses = normal > 0.0
        grip = self._grip(foot[presses], forces[presses]) if presses.any() else 0.0
        sliding = math.hypot(*rubbed.sum(axis=0).tolist())
        return GripMessage(
            grip=grip,
            load=sliding,
            ratio=sliding / (2.0 * grip) if grip > 0.0 else 0.0,
            normal=tuple(normal.tolist()),
            tangential=tuple(tangential.tolist()),
            margin=tuple((normal - tangential / self.mu_static).tolist()),
        )
