"""A node that fails in one of many ways at a step, and a connection that does, for random faults."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from nodes_for_runs import Spring

from palpate.launch.run.wire.outlet import Sender
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


def _exhaust() -> None:
    np.ones(1 << 60, dtype=np.int8)


def _step_clock() -> None:
    """Set the wall clock of this process back by 1 h."""
    wall, wall_ns = time.time, time.time_ns
    time.time = lambda: wall() - 3600.0
    time.time_ns = lambda: wall_ns() - 3_600_000_000_000


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
    "asks for more memory than there is": _exhaust,
}
"""Failures that end a run."""
BEARABLE = {
    "sends nothing once": lambda: None,
    "dozes": lambda: time.sleep(0.3),
    "sends a state of a megabyte": lambda: _force(state="x" * 1_000_000),
    "forks": _fork,
    "starts a program": lambda: subprocess.Popen(["sleep", "1000"]),
    "steps the clock": _step_clock,
}
"""Failures that a run may survive or not; in both cases no process may remain."""


class Wire:
    """Handles the frames that this process sends to nodes of other processes. The node sets `how` at its step."""

    how = ""

    def __init__(self) -> None:
        self.held: Callable[[], None] | None = None

    def carry(self, send: Callable[[], None], garbled: Callable[[], None]) -> None:
        """Send one frame, with the fault."""
        how, Wire.how = Wire.how, ""
        if how == "loses a frame":
            return
        if how == "swaps two frames":
            self.held = send
            return
        if how == "is slow once":
            time.sleep(0.3)
        for _ in range({"sends a frame twice": 2, "floods": 20_000}.get(how, 1)):
            (garbled if how == "garbles a frame" else send)()
        if self.held is not None:
            held, self.held = self.held, None
            held()


WIRES = {
    "loses a frame": True,
    "swaps two frames": True,
    "garbles a frame": True,
    "is slow once": False,
    "sends a frame twice": False,
    "floods": False,
}
"""Faults of a connection, and whether they end a run on the simulated clock, where each message is awaited."""


_send = Sender.send


def _send_by_wire(self: Sender, payload: bytes) -> None:
    """Send a message by the faulty connection of its stream, or normally if no fault was set."""
    if not hasattr(self, "wire"):
        self.wire = Wire()
    self.wire.carry(lambda: _send(self, payload), lambda: _send(self, b"\xc1" + payload))


Sender.send = _send_by_wire


class Unlucky(Spring):
    """Does `how` at its step `at`."""

    how: Annotated[str, "1"] = "raises"
    at: Annotated[int, "1"] = 20

    def start(self) -> None:
        self.count = 0

    def step(self, pose: Pose) -> Force:
        self.count += 1
        if self.count == self.at:
            if self.how in WIRES:
                Wire.how = self.how
                return super().step(pose)
            done = (BREAKS | BEARABLE)[self.how]()
            if done is not None and not isinstance(done, subprocess.Popen):
                return done
        return super().step(pose)
