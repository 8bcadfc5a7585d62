"""Nodes that tell what their process holds."""

import gc
import sys

from nodes_for_runs import Spring

from palpate.messages import Force, Pose


class Blocks(Spring):
    """A spring whose energy is the number of blocks of memory that Python has allocated, and whose force along z says
    how often the collector has run."""

    def step(self, pose: Pose) -> Force:
        pull = super().step(pose).force[0]
        ran = sum(generation["collections"] for generation in gc.get_stats())
        return Force(force=(pull, 0.0, float(ran)), state="free", energy=float(sys.getallocatedblocks()))


class Keeps(Blocks):
    """Appends to a list at each step."""

    def start(self) -> None:
        self.kept: list[Pose] = []

    def step(self, pose: Pose) -> Force:
        self.kept.append(pose)
        return super().step(pose)


class Cycles(Blocks):
    """Makes an object at each step that only the collector could free."""

    def step(self, pose: Pose) -> Force:
        cycle: list[object] = []
        cycle.append(cycle)
        return super().step(pose)
