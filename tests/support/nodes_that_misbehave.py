"""A custom node that fails in a chosen way, for the tests of whole runs."""

import contextlib
import ctypes
import os
import subprocess
import sys
import time
from typing import Annotated

import numpy as np

from palpate.messages import Floats, Force, Message, Pose, Torque
from palpate.nodes.base import Node


class Sheet(Message):
    """A custom message with an array.

    cells [N] (m, n)  forces
    count [1] ()      a whole number
    """

    cells: Annotated[Floats, "N", ("m", "n")]
    count: Annotated[int, "1"]


class Source(Node):
    """A point that moves steadily; the paced node."""

    paced = True

    def start(self) -> None:
        self.x = 0.0

    def step(self, torque: Torque | None, *, dt: float) -> Pose:
        self.x += dt
        return Pose(position=(self.x, 0.0, 0.0), velocity=(1.0, 0.0, 0.0), dt=dt)


class End(Node):
    """Closes the loop."""

    sink = True

    def step(self, force: Force) -> Torque:
        return Torque(torques=force.force)


class ToSheet(Node):
    """Converts a pose to the custom message."""

    def step(self, pose: Pose) -> Sheet:
        return Sheet(cells=np.full((3, 4), pose.position[0], dtype=np.float32), count=np.int64(7))


class FromSheet(Node):
    """Converts the custom message to a force."""

    def step(self, sheet: Sheet) -> Force:
        return Force(force=sheet.cells[1, :3], state="free", energy=np.float64(sheet.count))


class Bad(Node):
    """Fails as described by `how`, in the named call; in `step` at tick 50."""

    how: Annotated[str, "1"] = ""

    def start(self) -> None:
        self.count = 0
        if self.how.startswith("start "):
            print(self.how, flush=True)
            _do(self.how.removeprefix("start "))

    def stop(self) -> None:
        if self.how.startswith("stop "):
            _do(self.how.removeprefix("stop "))

    def step(self, pose: Pose) -> Force:
        self.count += 1
        state: object = "free"
        force: object = (1.0, 0.0, 0.0)
        if self.how == "print":
            print("x" * 100)
        elif self.how == "no line end":
            sys.stdout.write("y")
        elif self.how == "slow":
            time.sleep(0.1)
        elif self.how == "numpy":
            force = np.array([1.0, 2.0, 3.0], dtype=np.float32)
        if self.count == 50:
            match self.how:
                case "nan":
                    force = (0.0, float("nan"), 0.0)
                case "huge":
                    force = (0.0, 1e300, 0.0)
                case "shape":
                    force = (1.0, 2.0)
                case "text":
                    force = "abc"
                case "whole number as state":
                    state = 3
                case "surrogate":
                    state = "\udcff"
                case "none":
                    return None  # type: ignore[return-value]
                case _:
                    _do(self.how)
        return Force(force=force, state=state, energy=0.0)  # type: ignore[arg-type]


def _do(what: str) -> None:
    match what:
        case "raise":
            raise RuntimeError("out of luck")
        case "exit":
            sys.exit(0)
        case "interrupt":
            raise KeyboardInterrupt
        case "end":
            os._exit(0)
        case "crash":
            ctypes.string_at(0)
        case "hang":
            time.sleep(1000)
        case "tell":
            print("stopped in order", flush=True)
        case "doze":
            time.sleep(2.0)
        case "deaf":
            with contextlib.suppress(KeyboardInterrupt):
                time.sleep(1000)
            time.sleep(1000)
        case "spin":
            while True:
                pass
        case "long":
            until = time.monotonic() + 0.1
            while time.monotonic() < until:  # the watchdog checks once
                pass
            sum(range(60_000_000))  # one call, in which no signal is handled
        case "fork":
            if os.fork() == 0:
                time.sleep(1000)
                os._exit(0)
        case "program":
            subprocess.Popen(["sleep", "1000"])
