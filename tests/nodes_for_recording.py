"""Nodes for the tests of recordings that run in processes of their own."""

from __future__ import annotations

import os
import time
from typing import Annotated

from nodes_for_runs import Drag, Source

from palpate.messages import Force, Friction, Pose, Torque
from palpate.nodes.logger import Mcap


class Dying(Mcap):
    """A logger whose process is killed at a chosen tick."""

    at: Annotated[int, "1"] = 100

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        if tick >= self.at:
            os.kill(os.getpid(), 9)
        super().observe(stream, tick, payload)


class SlowDrag(Drag):
    """Takes far longer than a period now and then, so that others must hold its last answer; counts its steps."""

    def start(self) -> None:
        self.steps = 0

    def step(self, pose: Pose, force: Force, *, dt: float) -> Friction:
        self.steps += 1
        if not self.steps % 40:
            time.sleep(0.008)
        found = super().step(pose, force)
        return Friction(force=found.force, bristle=(self.steps * 1e-3, dt, 0.0), stick=False)


class Wanderer(Source):
    """A source that is late now and then."""

    def step(self, torque: Torque | None, *, dt: float) -> Pose:
        found = super().step(torque, dt=dt)
        if abs(self.x) < 0.02:
            time.sleep(0.004)
        return found


class Counting(SlowDrag):
    """Kills its process at a chosen step, once: in a process that was started again it lives."""

    how: Annotated[str, "1"] = "kill"
    at: Annotated[int, "1"] = 0

    def step(self, pose: Pose, force: Force, *, dt: float) -> Friction:
        if self.steps + 1 == self.at and pose.time < 3e8:
            os.kill(os.getpid(), 9)
        return super().step(pose, force, dt=dt)
