"""Nodes that report the memory of their process."""

import gc
import sys

from nodes_for_runs import Spring

from palpate.messages import Force, Pose


class Blocks(Spring):
    """A spring whose energy is the number of memory blocks that Python has allocated, and whose force along z is the
    number of garbage collections."""

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
    """Creates an object at each step that only the garbage collector can free."""

    def step(self, pose: Pose) -> Force:
        cycle: list[object] = []
        cycle.append(cycle)
        return super().step(pose)
