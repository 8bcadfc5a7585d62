"""A port of compiled code that reads frames from a socket, with its memory before unreadable pages."""

import ctypes

import numpy as np
from guarded import Form, Guarded

from palpate.compiler.entry_point import entry_point
from palpate.compiler.kernel import kernel
from palpate.engine.table import INPUT
from palpate.launch.run.hop.frames import DONTWAIT, ODD, WHOLE, fill, peek, port_at, take, wire_at
from palpate.launch.run.hop.table import PORT, WIRE
from palpate.messages import Torque

TOPIC = b"pose\0"
ARENA = 64


@kernel
def read_frame(address):
    """Take the next message of a port; the state of its frame."""
    port = port_at(address)
    state = peek(port)
    if state == WHOLE:
        take(port)
    return state


@kernel
def receive(address):
    """Receive into the buffer of a port's wire."""
    return fill(wire_at(port_at(address).wire), DONTWAIT)


class Stream:
    """A port with a wire of `room` bytes; buffer, records and memory for arrays lie before unreadable pages."""

    def __init__(self) -> None:
        self._form, self._memory = Form(Torque, "src"), Guarded(2)
        self._pairs = [(Guarded(1), Guarded(1)) for _ in range(2)]
        self._topic, self._input = np.frombuffer(TOPIC, np.uint8), np.zeros(1, INPUT)
        self.wire, self.port = np.zeros(1, WIRE), np.zeros(1, PORT)
        self._read, self._receive = entry_point(read_frame, 0), entry_point(receive, 0)
        self.size = self._form.blank.nbytes

    def begin(self, number: int, room: int) -> None:
        """Read another connection."""
        wire, port = self.wire[0], self.port[0]
        wire["fd"], wire["buffer"], wire["room"], wire["end"] = number, self._memory.end - room, room, 0
        wire["topic"], wire["skip"], wire["port"] = self._topic.ctypes.data, len(TOPIC), self.port.ctypes.data
        port["wire"], port["line"] = self.wire.ctypes.data, self._input.ctypes.data
        port["begin"] = port["ahead"] = 0
        port["form"], port["space"] = self._form.address, ARENA
        for (record, arena), names in zip(self._pairs, (("record", "arena"), ("spare", "other")), strict=True):
            port[names[0]], port[names[1]] = record.end - self.size, arena.end - ARENA
            ctypes.memset(record.end - self.size, 0, self.size)

    def read(self) -> tuple[list[int], int]:
        """The ticks of the messages that have arrived, and the state of the frame after them."""
        ticks = []
        while True:
            self._receive(self.port.ctypes.data)
            while (state := self._read(self.port.ctypes.data)) == WHOLE:
                data = ctypes.string_at(int(self.port["record"][0]), self.size)
                ticks.append(int(np.frombuffer(data, self._form.blank.dtype)["tick"][0]))
            if state == ODD or self._receive(self.port.ctypes.data) <= 0:
                return ticks, state
