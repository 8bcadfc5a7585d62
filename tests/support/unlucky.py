"""A node that goes wrong in one of many ways at one of its steps, for faults that are drawn at random."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from typing import Annotated, Any

import numpy as np
from nodes_for_runs import Spring

from palpate.messages import Force, Pose


def _force(**changes: Any) -> Force:
    return Force(**{"force": (1.0, 0.0, 0.0), "state": "free", "energy": 0.0} | changes)


def _raise() -> None:
    raise RuntimeError("out of luck")


def _interrupt() -> None:
    raise KeyboardInterrupt


def _spin() -> None:
    while True:
        pass


def _print() -> None:
    while True:
        print("x" * 1000)


def _eat() -> None:
    eaten = [np.ones(2_000_000) for _ in range(20)]
    while eaten:
        time.sleep(0.01)


def _fork() -> None:
    if os.fork() == 0:
        time.sleep(1000)
        os._exit(0)


BREAKS = {
    "raises": _raise,
    "returns NaN": lambda: _force(force=(float("nan"), 0.0, 0.0)),
    "returns infinity": lambda: _force(energy=float("inf")),
    "returns a dictionary": lambda: {"force": 1.0},
    "returns a wrong shape": lambda: _force(force=(1.0, 2.0)),
    "returns a wrong type": lambda: _force(force="abc"),
    "returns what cannot be encoded": lambda: _force(state="\udcff"),
    "hangs": lambda: time.sleep(1000),
    "spins": _spin,
    "exits": lambda: os._exit(7),
    "leaves": lambda: sys.exit(0),
    "interrupts itself": _interrupt,
    "kills itself": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "stops itself": lambda: os.kill(os.getpid(), signal.SIGSTOP),
    "crashes": lambda: ctypes.string_at(0),
    "prints without end": _print,
    "closes its descriptors": lambda: os.closerange(3, 512),
    "eats memory and hangs": _eat,
}
"""Ways that end a run."""
BEARABLE = {
    "sends nothing once": lambda: None,
    "dozes": lambda: time.sleep(0.3),
    "sends a state of a megabyte": lambda: _force(state="x" * 1_000_000),
    "forks": _fork,
    "starts a program": lambda: subprocess.Popen(["sleep", "1000"]),
    "starts a program in a session of its own": lambda: subprocess.Popen(["sleep", "1000"], start_new_session=True),
}
"""Ways that a run may survive, or not: what counts is that nothing is left of it."""


class Unlucky(Spring):
    """Does `how` at its step `at`."""

    how: Annotated[str, "1"] = "raises"
    at: Annotated[int, "1"] = 20

    def start(self) -> None:
        self.count = 0

    def step(self, pose: Pose) -> Force:
        self.count += 1
        if self.count == self.at:
            done = (BREAKS | BEARABLE)[self.how]()
            if done is not None and not isinstance(done, subprocess.Popen):
                return done
        return super().step(pose)
