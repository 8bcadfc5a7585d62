"""Derivatives of the observed force by settings, for `info["gradient"]` of an environment (docs/gym.md).

Each environment has 6 lanes for each setting, with the same actions and with the setting moved up and down by three
steps, and one that moves nothing; the derivatives follow by `gradients.differences`. They are those of the force at the
last step of the environment by a setting that would have differed since the start of the episode, at fixed actions.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.gradients.lanes import Differences
from palpate.gradients.parameters import Parameter, find_parameter
from palpate.gym.hands import Hand
from palpate.gym.lanes import TaskLanes
from palpate.launch.load.checks.ideal import describe_jumps
from palpate.nodes.base import plain
from palpate.physics.errors import ArgumentError
from palpate.stepping import Stepper

RECENT = 256  # steps of the environment whose noise and derivatives determine what settles
TOLERANCE = 1e-4
"""[1] Largest error of a derivative over its RMS in the recent steps."""


def parameters_of(plan: Plan, by: Sequence[str]) -> list[Parameter]:
    """The settings of nodes with these paths. ArgumentError: one is not valid, or results jump."""
    if isinstance(by, str) or not all(isinstance(path, str) for path in by) or len(set(by)) < len(by):
        raise ArgumentError(f"gradient: found {by!r}, expected different settings, such as ['tissue.stiffness']")
    graph, running = plan.graph, list(plan.order)
    found = [find_parameter(graph, path, running) for path in by]
    for each in found:
        if not each.node:
            raise ArgumentError(f"gradient: found {each.path!r}, expected a setting of a node: {', '.join(running)}")
    if found and (jumps := describe_jumps(graph, running)):
        raise ArgumentError(f"gradient: {jumps.partition(';')[0]}, so it has no derivatives; pass ideal=True")
    return found


class GradientLanes:
    """Lanes for the derivatives of the forces of some environments.

    stepper, hands, shape  see `TaskLanes`
    by         paths of the settings
    count      number of environments
    tolerance  largest error of a derivative over its RMS in the recent steps [1]
    """

    def __init__(
        self, stepper: Stepper, hands: Sequence[Hand], shape: tuple[int, ...], by: Sequence[str], count: int,
        tolerance: float = TOLERANCE,
    ) -> None:  # fmt: skip
        self._parameters = parameters_of(stepper.plan, by)
        self._graph, self._tolerance = stepper.plan.graph, tolerance
        self._size = 1 + 6 * len(self._parameters)  # lanes of an environment
        self._all = TaskLanes(stepper, hands, shape, count * self._size)
        self.lanes = self._all.lanes
        self._work: list[Differences | None] = [None] * count
        self._forces: list[list[np.ndarray]] = [[] for _ in range(count)]
        self._values, self._errors = np.zeros((2, count, len(self._parameters), *shape))

    def begin(self, number: int, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Begin an episode of an environment, with these changes of settings."""
        bases = [self._given(each, changes) for each in self._parameters]
        values = [each.read(base) for each, base in zip(self._parameters, bases, strict=True)]
        work = Differences(self._parameters, values)
        for lane, row in enumerate(work.rows):
            there = {node: dict(settings) for node, settings in changes.items()}
            if row.parameter is not None:
                each, base = self._parameters[row.parameter], bases[row.parameter]
                node, _, name = each.target.partition(".")
                there.setdefault(node, {})[name] = each.put(work.value(row, row.parameter), base)
            self._all.begin(number * self._size + lane, there)
        self._work[number], self._forces[number] = work, []
        self._values[number] = self._errors[number] = 0.0

    def _given(self, each: Parameter, changes: Mapping[str, Mapping[str, Any]]) -> Any:
        """The value of the target of a parameter in an episode, as plain data."""
        node, _, name = each.target.partition(".")
        value = plain(changes.get(node, {}).get(name, self._graph.nodes[node].settings[name]))
        return list(value) if isinstance(value, tuple) else value

    def steer(self, speeds: Mapping[int, np.ndarray]) -> list[tuple[int, int]]:
        """Set the velocities of the goals of environments; returns the first and the number of the lanes of each."""
        spans = []
        for number, speed in speeds.items():
            work = self._work[number]
            assert work is not None
            first = number * self._size
            for lane in range(len(work.rows)):
                self._all.steer(first + lane, speed)
            spans.append((first, len(work.rows)))
        return spans

    def step(self, speed: Sequence[float] | np.ndarray, ticks: int) -> None:
        """A step of a single environment."""
        for first, count in self.steer({0: np.asarray(speed)}):
            self.lanes.run(first, count, ticks)

    def collect(self, numbers: Iterable[int]) -> None:
        """Compute the derivatives after a step of these environments. RunError: a lane failed."""
        forces = self._all.observe()["force"]
        for number in numbers:
            work, first = self._work[number], number * self._size
            assert work is not None
            lanes = np.arange(first, first + len(work.rows))
            self._all.check(lanes[self.lanes.ticks[lanes] != self.lanes.ticks[first]])
            history = self._forces[number] = [*self._forces[number], forces[lanes]][-RECENT:]
            results = np.stack(history, axis=1)
            for place in range(len(self._parameters)):
                found = work.derivative(results, place, self._tolerance)
                self._values[number, place] = np.where(found.settled, found.value, np.nan)[-1]
                self._errors[number, place] = found.error[-1]

    def infos(self, mask: np.ndarray) -> dict[str, np.ndarray]:
        """The entries of `info` for several environments."""
        given = {"gradient": self._values.copy(), "gradient_error": self._errors.copy()}
        return given | {f"_{name}": mask.copy() for name in given}

    def info(self) -> dict[str, np.ndarray]:
        """The entries of `info` of a single environment."""
        return {"gradient": self._values[0].copy(), "gradient_error": self._errors[0].copy()}

    def close(self) -> None:
        """Stop all nodes."""
        self._all.close()
