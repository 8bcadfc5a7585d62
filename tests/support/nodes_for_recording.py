"""Nodes for the tests of recordings, run in separate processes."""

import os
import time
from pathlib import Path
from typing import Annotated

from nodes_for_runs import Drag, Source, Spring

from palpate.messages import Force, Friction, Load, Pose, Surface, Torque
from palpate.nodes.deformation import MassSpring
from palpate.nodes.logger import Mcap


def doze(seconds: float) -> None:
    """Sleep in short parts, so that a stall of the machine replaces only one of them."""
    for _ in range(round(seconds / 0.01)):
        time.sleep(0.01)


class Dying(Mcap):
    """A logger whose process is killed at a chosen tick."""

    at: Annotated[int, "1"] = 100

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        if tick >= self.at:
            os.kill(os.getpid(), 9)
        super().observe(stream, tick, payload)


class SlowDrag(Drag):
    """Takes far longer than a period at some steps, so that others must hold its last output; counts its steps."""

    def start(self) -> None:
        self.steps = 0

    def step(self, pose: Pose, force: Force, *, dt: float) -> Friction:
        self.steps += 1
        if not self.steps % 40:
            time.sleep(0.008)
        friction = super().step(pose, force)
        return Friction(force=friction.force, bristle=(self.steps * 1e-3, dt, 0.0), stick=False)


class Wanderer(Source):
    """A source that is late at some ticks."""

    def step(self, torque: Torque | None, *, dt: float) -> Pose:
        pose = super().step(torque, dt=dt)
        if abs(self.x) < 0.02:
            time.sleep(0.004)
        return pose


class Behind(Source):
    """A source whose messages arrive several periods after their tick."""

    def step(self, torque: Torque | None, *, dt: float) -> Pose:
        time.sleep(0.006)
        return super().step(torque, dt=dt)


class Counting(SlowDrag):
    """Kills its process once at a chosen step; the restarted process continues."""

    at: Annotated[int, "1"] = 0
    note: Annotated[str, "1"] = ""
    """A file that marks that it was killed."""

    def step(self, pose: Pose, force: Force, *, dt: float) -> Friction:
        if self.steps + 1 == self.at and not Path(self.note).exists():
            Path(self.note).touch()
            os.kill(os.getpid(), 9)
        return super().step(pose, force, dt=dt)


class Late(Spring):
    """Takes a while for each force."""

    delay: Annotated[float, "s"] = 0.01

    def step(self, pose: Pose) -> Force:
        time.sleep(self.delay)
        return super().step(pose)


class Dozing(Drag):
    """Falls silent once, at a chosen step."""

    at: Annotated[int, "1"] = 10
    seconds: Annotated[float, "s"] = 1.0

    def start(self) -> None:
        self.steps = 0

    def step(self, pose: Pose, force: Force) -> Friction:
        self.steps += 1
        if self.steps == self.at:
            doze(self.seconds)
        return super().step(pose, force)


class DozingTissue(MassSpring):
    """Stops once at a chosen step, together with all nodes of its process."""

    at: Annotated[int, "1"] = 500
    seconds: Annotated[float, "s"] = 0.15

    def start(self) -> None:
        super().start()
        self.steps = 0

    def step(self, load: list[Load], *, dt: float) -> Surface:
        self.steps += 1
        if self.steps == self.at:
            doze(self.seconds)
        return super().step(load, dt=dt)
