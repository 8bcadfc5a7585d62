"""The task: find a hard nodule in soft tissue by touch, and report its position (docs/gym.md)."""

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from palpate.gym.hands import SPEED, Changes
from palpate.gym.touch import Touch
from palpate.nodes.base.nodule import WithNodule
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.mesh import Mesh, heights, summit
from palpate.stepping import Tick

FIELD = 0.012
"""[m] Largest distance of the nodule from the centre of the field along x and along y."""
GENTLE = 2.0
"""[N] Normal force above which the reward decreases."""
HELD = 20
"""Number of steps in a row in which the action means "here", until the episode ends. Exploration noise that is
independent in each step practically never does that: at a probability of 1/2 per step once in 2 million steps."""


class FindNodule(Touch):
    """Find a nodule below the surface and report when the finger is above it.

    The action has a fourth number; a value above 0.5 means "here". The episode ends after `HELD` steps in a row with
    "here", or after its duration of D seconds. In both cases the finger's place is the answer. With the normal force f,
    the reward of a step of T seconds is

        r = -T/D (1 + max(0, f/2 N - 1)),   in the last step, at the time t,   + q - (1 - q) (1 - t/D)

    with q = exp(-(d/a)^2), the distance d from the contact's foot point to the point of the surface above the nodule,
    and the nodule's radius a. An answer far from the nodule costs the time that it saves, so that its return is -1 at
    any time, and ending early is not better than a search. A gentle episode has the return q (2 - t/D) - 1. The
    position of the nodule is uniform in a square of 24 mm in each episode, with `organ` around its top. `info` has
    `distance` d [m] in the last step. Arguments are those of `Touch`; the graph has a body that supports a nodule.
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
        self._held = 0  # steps in a row with "here"
        self._middle, self._height = node.position, node.nodule_position[2]
        self._organ: Mesh | None = None
        self._hover = self._begins[0][2]
        if given.get("organ") is not None:  # the hand hovers above the organ's top as it begins above the organ
            self._organ, begin = node.mesh(), np.array(self._begins[0])
            above = self._hover - float(heights(self._organ, begin[None, :2])[0])
            x, y, self._height = summit(self._organ, FIELD).tolist()
            self._middle, self._hover = (x, y, self._height), self._height + above
        low, high = [-SPEED] * 3 + [0.0], [SPEED] * 3 + [1.0]
        self.action_space = Box(np.array(low, np.float32), np.array(high, np.float32))

    def draw_settings(self) -> Changes:
        x, y = self.np_random.uniform(-FIELD, FIELD, 2).tolist()
        place, self._held = (self._middle[0] + x, self._middle[1] + y, self._height), 0
        if self._organ is not None:
            height = float(heights(self._organ, np.array([place[:2]]))[0])
            place = (*place[:2], self._height if math.isnan(height) else height)
        return {
            self.body: {"nodule_position": place},
            self.hands[0].device: {"begin": (self._middle[0], self._middle[1], self._hover)},
        }

    def judge(self, tick: Tick, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        contact = self.contact_of(tick, self.hands[0])
        reward = -self.step_time / self.duration * (1.0 + max(0.0, contact.force / GENTLE - 1.0))
        self._held = self._held + 1 if action[3] > 0.5 else 0
        if self._held < HELD and tick.time < self.duration:
            return reward, False, {}
        distance = math.dist(contact.foot, self.setting(self.body, "nodule_position"))
        quality = math.exp(-((distance / self.setting(self.body, "nodule_radius")) ** 2))
        left = max(0.0, 1.0 - tick.time / self.duration)
        return reward + quality - (1.0 - quality) * left, True, {"distance": distance}
