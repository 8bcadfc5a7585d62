"""The nodes of a simulated run. Each call of them takes virtual time and may be the one that a fault breaks."""

from __future__ import annotations

from typing import Protocol

from palpate.messages import Force, Friction, Pose, Torque
from palpate.nodes.base import Node, Observer


class Watcher(Protocol):
    """The simulation that runs the nodes."""

    def act(self, node: str, call: str) -> None:
        """A call of a node, or one message of the logger: it takes time, or fails."""

    def take(self, stream: str, tick: int) -> None:
        """The logger takes a message."""


watchers: list[Watcher] = []
"""The simulation that runs now."""


def act(node: str, call: str) -> None:
    """Pass a call to the simulation."""
    if watchers:
        watchers[-1].act(node, call)


class _Acting(Node):
    def start(self) -> None:
        act(type(self).__name__.lower(), "start")

    def stop(self) -> None:
        act(type(self).__name__.lower(), "stop")

    def _act(self) -> None:
        act(type(self).__name__.lower(), "step")


class Source(_Acting):
    """A device."""

    paced = True
    sink = True

    def step(self, torque: Torque | None) -> Pose:
        self._act()
        return Pose(position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), dt=1e-3)


class Second(Source):
    """Another device."""


class Spring(_Acting):
    """A node that the force needs."""

    def step(self, pose: Pose) -> Force:
        self._act()
        return Force(force=(0.0, 0.0, 0.0), state="free", energy=0.0)


class Drag(_Acting):
    """An optional effect."""

    def step(self, pose: Pose, force: Force) -> Friction:
        self._act()
        return Friction(force=(0.0, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=False)


class Sum(_Acting):
    """The torque of the device."""

    def step(self, force: Force, friction: Friction | None) -> Torque:
        self._act()
        return Torque(torques=(0.0, 0.0, 0.0))


class Log(Observer):
    """A logger."""

    def start(self) -> None:
        act("log", "start")

    def stop(self) -> None:
        act("log", "stop")

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        act("log", "step")
        if watchers:
            watchers[-1].take(stream, tick)
