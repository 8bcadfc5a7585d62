"""The task: find a hard nodule in soft tissue by touch, and say where it is (docs/gym.md)."""

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from palpate.gym.touch import SPEED, Changes, Touch
from palpate.nodes.base.nodule import WithNodule
from palpate.physics.errors import ArgumentError
from palpate.stepping import Tick

FIELD = 0.012
"""[m] The nodule lies within this of the middle of the field along x and y."""
GENTLE = 2.0
"""[N] of normal force; more costs reward."""


class FindNodule(Touch):
    """A nodule lies somewhere below the surface; the episode ends when the hand says that it is under the finger.

    The action has a fourth number: above 0.5 it says "here". The reward of a step of T seconds in an episode of at most
    D seconds is

        r = -T/D (1 + max(0, f/2 N - 1))  +  exp(-(d/a)^2) where "here" is said

    f the normal force, d the distance of the contact's foot point from the point of the surface above the nodule,
    a the nodule's radius. Each episode has the nodule at another place, uniform in a square of 24 mm. `info` has
    `distance` d [m] in the step that ends it. Arguments are those of `Touch`; the graph has a body that can have a
    nodule.
    """

    def __init__(self, graph: str = "nodule", duration: float = 15.0, **given: Any) -> None:
        super().__init__(graph, duration=duration, **given)
        order, nodes = self.stepper.plan.order, self.stepper.plan.graph.nodes
        bodies = [name for name in order if issubclass(nodes[name].cls, WithNodule)]
        if not bodies or len(self.hands) != 1:
            raise ArgumentError(
                f"{graph}: found {len(self.hands)} hands and {len(bodies)} bodies that can have a nodule, expected one "
                "hand and a body. Try the graph nodule"
            )
        self.body = bodies[0]
        node = self.stepper.node(self.body)
        assert isinstance(node, WithNodule)
        if node.nodule_radius == 0.0:
            raise ArgumentError(f"{graph}: setting nodule_radius of {self.body!r}: found 0 m, expected more than 0")
        self._middle, self._height = node.position, node.nodule_position[2]
        low, high = [-SPEED] * 3 + [0.0], [SPEED] * 3 + [1.0]
        self.action_space = Box(np.array(low, np.float32), np.array(high, np.float32))

    def draw(self) -> Changes:
        x, y = self.np_random.uniform(-FIELD, FIELD, 2).tolist()
        begin = self._begins[0]
        return {
            self.body: {"nodule_position": (self._middle[0] + x, self._middle[1] + y, self._height)},
            self.hands[0].device: {"begin": (self._middle[0], self._middle[1], begin[2])},
        }

    def judge(self, tick: Tick, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        contact = self.contact_of(tick, self.hands[0])
        reward = -self.step_time / self.duration * (1.0 + max(0.0, contact.force / GENTLE - 1.0))
        if action[3] <= 0.5:
            return reward, False, {}
        distance = math.dist(contact.foot, self.setting(self.body, "nodule_position"))
        radius = self.setting(self.body, "nodule_radius")
        return reward + math.exp(-((distance / radius) ** 2)), True, {"distance": distance}
