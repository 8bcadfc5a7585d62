"""Haply's 2diy: a planar pantograph behind a serial port (Arduino Due or M0), by the maker's open library hAPI.

The host speaks first: 00 00 resets the board; 01, the device's number and the layout of motors and encoders set it up;
02, the number and one float32 a motor [N m] command torques. Each command is answered by the number and one float32 an
encoder [deg]. Little-endian, no check sum, so an answer whose angles cannot be is left out.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable

import numpy as np

from palpate.drivers.connected import PortDriver
from palpate.drivers.emulate import EmulatedDevice
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import LIMITS
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.serial import Line
from palpate.physics.device.pantograph import Pantograph, cranks, handle, jacobian

NAME = "Haply 2diy"
BAUD = 115200  # of a USB serial port: any rate is the same
NUMBER = 5
ANSWER = 1 + 2 * 4
PATIENCE = 0.005  # [s] for an answer
CW, CCW = 0, 1

BUILDS = {
    2: (Pantograph(apart=0.0), ((CCW, 2), (CW, 1)), ((CCW, 241.0, 10752.0, 2), (CW, -61.0, 10752.0, 1))),
    3: (Pantograph(), ((CCW, 2), (CCW, 1)), ((CCW, 168.0, 4880.0, 2), (CCW, 12.0, 4880.0, 1))),
}
"""By the hardware's version: mechanism; direction and port of each motor; direction, angle at the start [deg], counts a
turn and port of each encoder."""


def setup(version: int) -> bytes:
    """The message that lays out motors and encoders: directions and numbers stand in the order of their ports."""
    _, motors, encoders = BUILDS[version]
    by_port = sorted(motors, key=lambda m: m[1])
    read = sorted(encoders, key=lambda e: e[3])
    return (
        bytes((1, NUMBER, sum(1 << port - 1 for _, port in by_port), *(turn for turn, _ in by_port)))
        + bytes((sum(1 << e[3] - 1 for e in read), *(e[0] for e in read), 0, 0))
        + b"".join(struct.pack("<2f", offset, counts) for _, offset, counts, _ in read)
    )


def torques(version: int, values: tuple[float, float]) -> bytes:
    """The message that sets the torques [N m] of motors 1 and 2, in the order of their ports."""
    order = sorted(range(2), key=lambda i: BUILDS[version][1][i][1])
    return bytes((2, NUMBER)) + struct.pack("<2f", *(values[i] for i in order))


class Haply2Diy(PortDriver[Line]):
    """The device on its line. Its command is a force [N] (2) in its plane; its position is (x, y, 0).

    connect  opens the line
    version  of the hardware: 2, of metal, or 3, of plastic
    """

    name = NAME
    limits = LIMITS["haply2diy"]
    size = 2

    def __init__(self, connect: Callable[[], Line], version: int = 3) -> None:
        super().__init__(connect)
        self.version = version
        self.mechanism = BUILDS[version][0]
        self.order = sorted(range(2), key=lambda i: BUILDS[version][2][i][3])

    def open(self) -> None:
        self.angles: tuple[float, float] | None = None
        self.port = self.connect()
        self.port.write(b"\0\0")
        time.sleep(0.1)
        self.port.write(setup(self.version))
        time.sleep(0.1)
        burst(self.port.read, 0.01)  # what it said before
        for _ in range(20):
            if self.cycle((0.0, 0.0)) is not None:
                return
        raise DeviceError(f"the {NAME} does not answer. Is this its port, and does it run the hAPI firmware?")

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        fx, fy = command
        rates = None if self.angles is None else jacobian(self.mechanism, *self.angles)
        given = (0.0, 0.0)
        if rates is not None:
            (a, b), (c, d) = rates
            given = a * fx + c * fy, b * fx + d * fy
        self.port.write(torques(self.version, given))
        data, deadline = b"", time.monotonic() + PATIENCE
        while len(data) < ANSWER and (left := deadline - time.monotonic()) > 0.0:
            data += self.port.read(left)
        return self._take(data)

    def _take(self, data: bytes) -> DeviceSample | None:
        if len(data) < ANSWER or len(data) % ANSWER or data[-ANSWER] != NUMBER:
            return None  # cut off, or two of which one is: the next answer begins anew
        angles = struct.unpack("<2f", data[-ANSWER + 1 :])
        if not all(math.isfinite(a) and abs(a) < 720.0 for a in angles):
            return None
        q = [0.0, 0.0]
        for place, encoder in enumerate(self.order):
            q[encoder] = math.radians(angles[place])
        where = handle(self.mechanism, q[0], q[1])
        if where is None:
            return None
        self.angles = q[0], q[1]
        return DeviceSample(time.monotonic_ns(), position=(*where, 0.0))


class Emulated2Diy(EmulatedDevice):
    """The board with its linkage and the hand that holds it, for `emulate.line.EmulatedLine`.

    The hand's script is in the device's plane: x, y, and z is not used.
    """

    def __init__(self, script: Script, version: int = 3, *, waits: bool = False) -> None:
        self.mechanism, self.motors, self.encoders = BUILDS[version]
        self.version = version
        self.hand = EmulatedOperator(script, waits)
        self.torques = (0.0, 0.0)
        self.ready = False
        self.heard = b""

    def hear(self, data: bytes, now: int) -> list[bytes]:
        self.heard += data
        said: list[bytes] = []
        layout = setup(self.version)
        while self.heard:
            kind = self.heard[0]
            length = {0: 2, 1: len(layout), 2: 10}.get(kind, 1)
            if len(self.heard) < length:
                break
            message, self.heard = self.heard[:length], self.heard[length:]
            if kind == 0:
                self.ready = False
            elif kind == 1:
                self.ready = message == layout
            elif kind == 2 and self.ready and message[1] == NUMBER:
                said.append(self._answer(message, now))
        return said

    def _answer(self, message: bytes, now: int) -> bytes:
        by_port = struct.unpack("<2f", message[2:])
        order = sorted(range(2), key=lambda i: self.motors[i][1])
        given = [0.0, 0.0]
        for place, motor in enumerate(order):
            given[motor] = by_port[place]
        self.hand.begin(now)
        x, y, _ = self.hand.move(self._force, now)
        self.torques = given[0], given[1]
        angles = cranks(self.mechanism, float(x), float(y)) or (0.0, 0.0)
        read = sorted(range(2), key=lambda i: self.encoders[i][3])
        turn = [360.0 / self.encoders[i][2] for i in range(2)]
        degrees = [turn[i] * round(math.degrees(angles[i]) / turn[i]) for i in read]
        return bytes((NUMBER,)) + struct.pack("<2f", *degrees)

    def _force(self, place: np.ndarray) -> tuple[float, float, float]:
        """F = J^-T torque."""
        angles = cranks(self.mechanism, float(place[0]), float(place[1]))
        rates = None if angles is None else jacobian(self.mechanism, *angles)
        if rates is None:
            return 0.0, 0.0, 0.0
        fx, fy = np.linalg.solve(np.array(rates).T, np.array(self.torques))
        return float(fx), float(fy), 0.0
