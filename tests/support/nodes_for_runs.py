"""Small nodes that the tests of the launcher run in separate processes."""

import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Annotated

import numpy as np

from palpate.messages import Force, Friction, Load, Pose, Torque
from palpate.nodes.base import Node, Observer
from palpate.nodes.logger import Mcap


class Source(Node):
    """An oscillating point, pushed by the torque of the loop."""

    paced = True
    sink = True
    gain: Annotated[float, "1"] = 0.3

    def start(self) -> None:
        self.x, self.v = 1.0, 0.0

    def step(self, torque: Torque | None, *, dt: float) -> Pose:
        h = min(dt, 0.1)  # [s] after a long stall the oscillation would diverge
        self.v += h * (-40.0 * self.x + (self.gain * torque.torques[0] if torque else 0.0))
        self.x += h * self.v
        return Pose(position=(self.x, 0.0, float(torque is None)), velocity=(self.v, 0.0, 0.0), dt=dt)


class Spring(Node):
    """A force from the pose."""

    stiffness: Annotated[float, "N/m"] = 5.0

    def step(self, pose: Pose) -> Force:
        return Force(force=(-self.stiffness * pose.position[0], 0.0, 0.0), state="free", energy=0.0)


class Drag(Node):
    """Friction from the pose and the force."""

    def step(self, pose: Pose, force: Force) -> Friction:
        return Friction(force=(0.1 * pose.velocity[0] * force.force[0], 0.0, 0.0), bristle=(0, 0, 0), stick=False)


class Both(Node):
    """A spring from each of the points that are not missing."""

    def step(self, poses: list[Pose | None]) -> Force:
        there = [pose.position[0] for pose in poses if pose is not None]
        return Force(force=(-sum(there), 0.0, 0.0), state="free", energy=0.0)


class FaultyDrag(Drag):
    """Fails at a chosen step."""

    at: Annotated[int, "1"] = 100

    def start(self) -> None:
        self.count = 0

    def step(self, pose: Pose, force: Force) -> Friction:
        self.count += 1
        if self.count == self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(pose, force)


class Spread(Node):
    """An array message from both."""

    count: Annotated[int, "1"] = 50

    def step(self, force: Force, friction: Friction | None) -> Load:
        total = force.force[0] + (friction.force[0] if friction else 0.0)
        forces = np.zeros((self.count, 3))
        forces[:50, 0] = total * np.arange(min(self.count, 50))  # below what a plausible force may be
        return Load(nodes=np.arange(self.count), forces=forces, foot=(0, 0, 0), normal=(0, 0, 1))


class Swell(Spread):
    """Some of its messages are larger than the receive buffer."""

    def start(self) -> None:
        self.steps = 0

    def step(self, force: Force, friction: Friction | None) -> Load:
        self.steps += 1
        self.count = 4000 if self.steps % 7 in (2, 3, 6) else 50
        return super().step(force, friction)


class Sum(Node):
    """Converts a load to a torque."""

    def step(self, load: Load, friction: Friction | None) -> Torque:
        return Torque(torques=(float(load.forces[:, 0].sum()) / 1225.0, float(friction is None), 0.0))


class Hold(Node):
    """Sends the force that it holds again at each pose."""

    def step(self, pose: Pose, force: Force) -> Force:
        return Force(force=force.force, state=force.state, energy=0.0)


class Turn(Node):
    """A torque of 1 N m while it receives a force."""

    def step(self, force: Force) -> Torque:
        return Torque(torques=(1.0, 0.0, 0.0))


class Starting(Spring):
    """Behaves in a chosen way in `start`; a slow one computes until a file exists."""

    how: Annotated[str, "1"] = "slow"
    file: Annotated[str, "1"] = ""

    def start(self) -> None:
        match self.how:
            case "exit":
                os._exit(7)
            case "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            case "stop":
                os.kill(os.getpid(), signal.SIGSTOP)
            case "exception":
                raise RuntimeError("cannot start")
            case "slow":
                compute_until(self.file)


class StartingDrag(Drag):
    """A slow start: it computes until a file exists."""

    file: Annotated[str, "1"] = ""

    def start(self) -> None:
        compute_until(self.file)


def compute_until(file: str) -> None:
    while not Path(file).exists():
        sum(range(10_000))


class Faulty(Spring):
    """Fails in a chosen way at a chosen step, and writes its tick to a file if one is given."""

    how: Annotated[str, "1"] = "raise"
    at: Annotated[int, "1"] = 20
    note: Annotated[str, "1"] = ""

    def start(self) -> None:
        if self.how == "start":
            raise RuntimeError("cannot start")
        if self.how == "no memory in start":
            raise MemoryError
        self.count = 0

    def step(self, pose: Pose) -> Force:
        self.count += 1
        if self.count == self.at:
            if self.note:
                Path(self.note).write_text(str(pose.tick))
            match self.how:
                case "raise":
                    raise RuntimeError("out of luck")
                case "no memory":
                    raise MemoryError("Unable to allocate 3 TiB")
                case "nan":
                    return Force(force=(float("nan"), 0.0, 0.0), state="free", energy=0.0)
                case "type":
                    return {"force": 1.0}
                case "input":
                    return pose
                case "hang":
                    time.sleep(1000)
                case "doze":
                    time.sleep(1.0)
                case "disk":
                    wait_at_the_disk(f"{self.note}.pipe")
                case "doze and die":
                    time.sleep(1.0)
                    os.kill(os.getpid(), 9)
                case "exit":
                    os._exit(7)
                case "kill":
                    os.kill(os.getpid(), 9)
                case "stop":
                    os.kill(os.getpid(), signal.SIGSTOP)
                case "spin":
                    while True:
                        pass
                case "print":
                    while True:
                        print("x" * 1000)
                case "eat":
                    eaten = [bytearray(10_000_000) for _ in range(20)]
                    while eaten:
                        time.sleep(0.01)
                case "terminate":
                    os.kill(os.getpid(), signal.SIGTERM)
                case "kill group" if os.getpgrp() == os.getpid() and os.getppid() != 1 and not replayed():
                    os.killpg(0, signal.SIGKILL)
        return super().step(pose)


class Follow(Node):
    """A force that follows another one, or zero without it."""

    def step(self, force: Force | None) -> Force:
        return Force(force=force.force if force else (0.0, 0.0, 0.0), state="free", energy=0.0)


class Work(Node):
    """Uses this processor time in one step."""

    seconds: Annotated[float, "s"] = 1.0
    at: Annotated[int, "1"] = 20

    def start(self) -> None:
        self.count = 0

    def step(self, pose: Pose) -> Force:
        self.count += 1
        if self.count == self.at:
            until = time.thread_time() + self.seconds
            while time.thread_time() < until:
                pass
        return Force(force=(-pose.position[0], 0.0, 0.0), state="free", energy=0.0)


class Collect(Observer):
    """Writes each payload as a line of hex to a file."""

    path: Annotated[str, "1"] = ""

    def start(self) -> None:
        self.file = open(self.path, "w")  # noqa: SIM115

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        self.file.write(f"{stream} {tick} {payload.hex()}\n")

    def stop(self) -> None:
        self.file.close()


class AtTheDisk(Observer):
    """Waits for a disk after a number of messages."""

    pipe: Annotated[str, "1"] = ""
    after: Annotated[int, "1"] = 500

    def start(self) -> None:
        self.count = 0

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        self.count += 1
        if self.count == self.after:
            wait_at_the_disk(self.pipe)


class Slow(Observer):
    """Pauses at each message."""

    pause: Annotated[float, "s"] = 0.0

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        time.sleep(self.pause)


class SlowLogger(Mcap):
    """A logger that pauses at each message."""

    pause: Annotated[float, "s"] = 0.0

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        time.sleep(self.pause)
        super().observe(stream, tick, payload)


def replayed() -> bool:
    """Whether this node runs in a replay, in the process of the tests, which must not be killed."""
    return os.environ.get("PALPATE_TESTS") == str(os.getpid())


def wait_at_the_disk(pipe: str) -> None:
    """Wait for a thread that waits in the kernel for 2 s, as for a disk, where no signal reaches it: a vforked child
    cannot open its standard input."""
    os.mkfifo(pipe)
    subprocess.Popen(["sh", "-c", f"sleep 2; : > {pipe}"])
    opens = [(os.POSIX_SPAWN_OPEN, 0, pipe, os.O_RDONLY, 0)]
    more = {"file_actions": opens}
    writer = threading.Thread(target=os.posix_spawn, args=("/bin/true", ["true"], {}), kwargs=more)
    writer.start()
    writer.join()
