"""Dot Pad: 60 x 40 dots that are up or down, and a line of braille, behind a serial port (FTDI 0403:6010).

As the screen reader NVDA speaks it. A packet is AA 55, the length of the body (two bytes, high first), the body: where
to, command (two bytes, high first), sequence number, data, and the exclusive or of all these with A5. A line of the
graphic display is one command: first cell, then one byte for each cell of two columns of four dots, from the top of the
left column.
"""

import struct
import time
from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import NamedTuple

import numpy as np

from palpate.drivers.connected import PortDriver
from palpate.drivers.emulate import EmulatedDevice
from palpate.drivers.errors import DeviceError
from palpate.drivers.framing import FrameReader
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import Limits
from palpate.drivers.transport.serial import SerialLine

NAME = "Dot Pad"
BAUD = 115200
SYNC, SEED = b"\xaa\x55", 0xA5
NAME_REQUEST, NAME_REPLY = 0x0100, 0x0101
BOARD_REQUEST, BOARD_REPLY = 0x0110, 0x0111
LINE_REQUEST, LINE_REPLY, LINE_DONE = 0x0200, 0x0201, 0x0202
GRAPHIC, TEXT = 0x80, 0x40  # features
BOARD = struct.Struct("12B")
# features, dots a cell, pin distance, keys, then rows, columns, -, time of text and graphic
CELL_WIDTH, CELL_HEIGHT = 2, 4
PATIENCE = 0.5  # [s] for an answer
PING = 0.5  # [s] without an answer after which it is asked for its name
LONGEST = 1024  # [bytes] of a body


class Packet(NamedTuple):
    """One packet: where to, command, sequence number, data."""

    to: int
    command: int
    sequence: int
    data: bytes


def pack(packet: Packet) -> bytes:
    body = bytes((packet.to,)) + struct.pack(">H", packet.command) + bytes((packet.sequence,)) + packet.data
    return SYNC + struct.pack(">H", len(body) + 1) + body + bytes((reduce(xor, body, SEED),))


class PacketReader(FrameReader[Packet]):
    """Finds packets in what comes off the line."""

    head = SYNC

    def parse(self, data: bytes) -> tuple[Packet | None, int]:
        if len(data) < 4:
            return None, 4
        length = int.from_bytes(data[2:4])
        if not 5 <= length <= LONGEST:
            return None, 0
        body, check = data[4 : 3 + length], data[3 + length : 4 + length]
        if check != bytes((reduce(xor, body, SEED),)):
            return None, 4 + length
        return Packet(body[0], int.from_bytes(body[1:3]), body[3], body[4:]), 4 + length


def cells(dots: list[bool], rows: int, columns: int) -> list[bytes]:
    """The bytes of each line of cells, of dots row by row."""
    blocks = np.array(dots).reshape(rows // CELL_HEIGHT, CELL_HEIGHT, columns // CELL_WIDTH, CELL_WIDTH)
    bits = blocks.transpose(0, 2, 3, 1).reshape(rows // CELL_HEIGHT, columns // CELL_WIDTH, -1)
    return [line.tobytes() for line in np.packbits(bits, axis=-1, bitorder="little")]


class DotPad(PortDriver[SerialLine]):
    """The display on its line. A command is one number for each dot, row by row: above 0 it is up.

    connect        opens the line
    rows, columns  of dots that are expected
    """

    name = NAME
    limits = Limits(float("inf"), float("inf"), float("inf"), silence=2.0)

    def __init__(self, connect: Callable[[], SerialLine], rows: int = 40, columns: int = 60) -> None:
        super().__init__(connect)
        self.rows, self.columns, self.size = rows, columns, rows * columns

    def open(self) -> None:
        self.reader = PacketReader()
        self.shown: dict[int, bytes] = {}
        self.waiting: dict[int, bytes] = {}
        self.port = self.connect()
        self.model = self._ask(NAME_REQUEST, NAME_REPLY).decode("ascii", errors="replace")
        reply = self._ask(BOARD_REQUEST, BOARD_REPLY)
        if len(reply) < BOARD.size:
            raise DeviceError(f"the {NAME} {self.model!r} sends {len(reply)} bytes about its board, not {BOARD.size}.")
        features, _, _, _, text_rows, _, _, _, rows, columns, _, _ = BOARD.unpack(reply[: BOARD.size])
        if not features & GRAPHIC:
            raise DeviceError(f"the {NAME} {self.model!r} has no graphic display.")
        self.first = text_rows if features & TEXT else 0
        if (rows * CELL_HEIGHT, columns * CELL_WIDTH) != (self.rows, self.columns):
            raise DeviceError(
                f"the {NAME} {self.model!r} has {rows * CELL_HEIGHT} x {columns * CELL_WIDTH} dots, expected"
                f" {self.rows} x {self.columns}. Give these as the settings `rows` and `columns`."
            )

    def _ask(self, command: int, reply: int) -> bytes:
        packet = self._exchange(Packet(0, command, 0, b""), reply)
        if packet is None:
            raise DeviceError(f"the {NAME} does not answer. Is this its port, and is it switched on?")
        return packet.data

    def _exchange(self, request: Packet, reply: int) -> Packet | None:
        """Send a packet; the reply to it, None where none comes in time."""
        self.port.write(pack(request))
        left, deadline = PATIENCE, time.monotonic() + PATIENCE
        while left > 0.0:
            left = deadline - time.monotonic()
            for packet in self.reader.feed(self.port.read(max(left, 0.0))):  # once more, if the machine stood still
                if packet.command == reply and request.to in (0, packet.to):
                    self.heard = time.monotonic()
                    return packet
        return None

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        """Send at most one changed line, and wait for its answer: a line takes milliseconds."""
        lines = cells([c > 0.0 for c in command], self.rows, self.columns)
        changed = next((i for i, line in enumerate(lines) if self.shown.get(i) != line), None)
        if changed is not None:
            request = Packet(self.first + changed, LINE_REQUEST, 0, b"\0" + lines[changed])
            answer = self._exchange(request, LINE_REPLY)
            if answer is not None and answer.data[:1] == b"\0":
                self.shown[changed] = lines[changed]
        elif time.monotonic() - self.heard > PING:
            answer = self._exchange(Packet(0, NAME_REQUEST, 0, b""), NAME_REPLY)
        else:
            self.reader.feed(self.port.read(0.01))
            return DeviceSample(time.monotonic_ns())
        return None if answer is None else DeviceSample(time.monotonic_ns())


class EmulatedDotPad(EmulatedDevice):
    """The display itself. dots: line of cells by number, as it shows them."""

    def __init__(self, rows: int = 40, columns: int = 60) -> None:
        self.rows, self.columns = rows, columns
        self.reader = PacketReader()
        self.dots: dict[int, bytes] = {}

    def hear(self, data: bytes, now: int) -> list[bytes]:
        said = []
        for packet in self.reader.feed(data):
            if packet.command == NAME_REQUEST:
                said.append(pack(Packet(0, NAME_REPLY, 0, b"DotPad320A")))
            elif packet.command == BOARD_REQUEST:
                rows, columns = self.rows // CELL_HEIGHT, self.columns // CELL_WIDTH
                board = (GRAPHIC | TEXT, 8, 25, 4, 1, 20, 0, 0, rows, columns, 0, 0)
                said.append(pack(Packet(0, BOARD_REPLY, 0, BOARD.pack(*board))))
            elif packet.command == LINE_REQUEST:
                self.dots[packet.to] = packet.data[1:]
                said.append(pack(Packet(packet.to, LINE_REPLY, packet.sequence, b"\0")))
                said.append(pack(Packet(packet.to, LINE_DONE, packet.sequence, b"\0")))
        return said
