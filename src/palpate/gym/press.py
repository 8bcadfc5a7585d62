"""The task: press tissue of unknown stiffness with a target force (docs/gym.md)."""

import math
from typing import Any

import numpy as np

from palpate.gym.hands import Changes
from palpate.gym.touch import Touch
from palpate.messages import Surface
from palpate.physics.errors import ArgumentError
from palpate.stepping import Tick

FORCES = 0.5, 2.5
"""[N] Range of the target force."""
FACTORS = 0.5, 2.0
"""[1] Range of the body's stiffness, relative to that of its graph."""


class Press(Touch):
    """Keep the normal force at a target, on a body whose stiffness changes with each episode.

    The observation has an additional part, `wanted` [N] (1). The reward of a step of T seconds in an episode of D
    seconds is

        r = T/D max(0, 1 - |f - w|/w)

    with the normal force f and the target w, uniform in 0.5 to 2.5 N. The body's stiffness is that of the graph times a
    factor, log-uniform in 1/2 to 2, and the hand starts up to 5 mm off centre along x and y. `info` has `error` |f - w|
    [N]. Arguments are those of `Touch`; the graph must have one hand and a body with a setting `stiffness`.
    """

    units = Touch.units | {"wanted": "N"}
    wanted = ("wanted",)

    def __init__(self, graph: str = "kidney", duration: float = 3.0, **given: Any) -> None:
        super().__init__(graph, duration=duration, **given)
        order, nodes = self.stepper.plan.order, self.stepper.plan.graph.nodes
        bodies = [
            name for name in order if Surface in nodes[name].streams.values() and "stiffness" in nodes[name].settings
        ]
        if not bodies or len(self.hands) != 1:
            raise ArgumentError(
                f"{graph}: found {len(self.hands)} hands and {len(bodies)} bodies with a stiffness, expected one hand "
                "and a body such as deformation.MassSpring. Try the graph kidney"
            )
        self.body = bodies[0]
        self._stiffness = nodes[self.body].settings["stiffness"]
        self.target = FORCES[0]
        """[N] Target force of this episode."""

    def draw_settings(self) -> Changes:
        self.target = float(self.np_random.uniform(*FORCES))
        factor = math.exp(self.np_random.uniform(math.log(FACTORS[0]), math.log(FACTORS[1])))
        x, y = self.np_random.uniform(-5e-3, 5e-3, 2).tolist()
        begin = self._begins[0]
        return {
            self.body: {"stiffness": self._stiffness * factor},
            self.hands[0].device: {"begin": (begin[0] + x, begin[1] + y, begin[2])},
        }

    def judge(self, tick: Tick, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        error = abs(self.contact_of(tick, self.hands[0]).force - self.target)
        return self.step_time / self.duration * max(0.0, 1.0 - error / self.target), False, {"error": error}

    def targets(self) -> dict[str, float]:
        return {"wanted": self.target}
