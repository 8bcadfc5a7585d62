"""Small nodes for the tests of studies, whose output is a formula of their settings, and one that fails."""

import math
import os
import signal
import time
from pathlib import Path
from typing import Annotated

import msgspec

from palpate.messages import Contact
from palpate.nodes.base import Node


def contact(force: float, indentation: float = 0.0, rate: float = 0.0) -> Contact:
    return Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0.0, indentation=indentation,
                   compression_rate=0.0, indentation_rate=rate)  # fmt: skip


class Ball(Node):
    """A rigid ball pressed into an elastic half-space, by Hertz: 4/3 E/(1 - nu^2) sqrt(R) d^1.5, d in equal steps."""

    paced = True
    young: Annotated[float, "Pa"] = 1e4
    poisson: Annotated[float, "1"] = 0.5
    radius: Annotated[float, "m"] = 8e-3
    depth: Annotated[float, "m"] = 1e-3
    steps: Annotated[int, "1"] = 5
    pause: Annotated[float, "s"] = 0.0
    what: Annotated[str, "1"] = ""
    flag: Annotated[str, "1"] = ""
    gate: Annotated[str, "1"] = ""
    """A file that the start waits for, 60 s at most."""

    def start(self) -> None:
        self.count = 0
        if self.flag:
            Path(self.flag).write_text(str(os.getpid()))
        time.sleep(self.pause)
        end = time.monotonic() + 60.0
        while self.gate and not Path(self.gate).exists():
            if time.monotonic() > end:
                raise TimeoutError(self.gate)
            time.sleep(0.01)
        if self.what == "fail":
            raise ValueError("the mesh is inside out")
        if self.what == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.what == "hang":
            while True:
                time.sleep(0.01)

    def step(self, *, dt: float) -> Contact:
        self.count = min(self.count + 1, self.steps)
        depth = self.depth * self.count / self.steps
        stiffness = 4.0 / 3.0 * self.young / (1.0 - self.poisson**2) * math.sqrt(self.radius)
        return contact(stiffness * depth**1.5, depth)


class Limited(Ball):
    """A ball whose settings have a range."""

    young: Annotated[float, "Pa", msgspec.Meta(gt=0.0)] = 1e4
    radius: Annotated[float, "m", msgspec.Meta(gt=0.0)] = 8e-3


class Ishigami(Node):
    """sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 (T. Ishigami, T. Homma, Proc. ISUMA (1990) 398-403)."""

    paced = True
    x1: Annotated[float, "1"] = 0.0
    x2: Annotated[float, "1"] = 0.0
    x3: Annotated[float, "1"] = 0.0

    def step(self, *, dt: float) -> Contact:
        value = math.sin(self.x1) + 7.0 * math.sin(self.x2) ** 2 + 0.1 * self.x3**4 * math.sin(self.x1)
        return contact(0.0, rate=value)
