"""The wires and ports of a hop: received bytes and messages, taken from the inlets and inputs, and returned to them."""

from __future__ import annotations

import numpy as np

from palpate.engine.segment import CompiledSegment, Entrance
from palpate.engine.slot import RemoteStream
from palpate.engine.wire_plan import wire_plan
from palpate.launch.run.hop.table import PORT, WIRE
from palpate.launch.run.wire.inlet import LONGEST_FRAME
from palpate.launch.run.wire.zmtp import Decoder, frame
from palpate.messages import pack
from palpate.messages.record import blank

BUFFER, ARENA = 1 << 17, 1 << 12  # [bytes] first sizes of a wire's buffer and of a port's memory for arrays


class Wire:
    """The connection of one stream."""

    def __init__(self, feed: RemoteStream) -> None:
        self.feed = feed
        self.line = np.zeros(1, WIRE)
        self.ports: list[Port] = []
        self.topic = np.frombuffer(feed.stream.encode() + b"\0", np.uint8)
        self.line["topic"], self.line["skip"] = self.topic.ctypes.data, len(self.topic)
        self._set_buffer(BUFFER)
        self._set_form()

    def _set_form(self) -> None:
        from palpate.launch.run.hop.decode import FORM  # the compiler is slow to import

        self._plan = plan = wire_plan(self.feed.kind, self.feed.producer)
        self._lengths, self._blank = np.zeros(max(1, plan.letters), np.int64), blank(self.feed.kind)
        self.form = np.zeros(1, FORM)
        self.form["steps"], self.form["count"] = plan.steps.ctypes.data, len(plan.steps)
        self.form["literals"], self.form["axes"] = plan.literals.ctypes.data, plan.axes.ctypes.data
        self.form["letters"], self.form["lengths"] = plan.letters, self._lengths.ctypes.data
        self.form["blank"] = self._blank.ctypes.data

    def _set_buffer(self, size: int) -> None:
        self._buffer = np.zeros(size, np.uint8)
        self.line["buffer"], self.line["room"] = self._buffer.ctypes.data, size

    def attach(self) -> None:
        """Take the bytes of the inlet, and encode the messages that wait in the ports again before them."""
        inlet = self.feed.inlet
        waiting = {message.tick: message for port in self.feed.ports for message in port.queue}
        topic = self.topic.tobytes()
        frames = [frame(topic + pack(waiting[tick])) for tick in sorted(waiting)]
        number, rest = inlet.lend()
        data = b"".join((*frames, rest))
        needed = max(len(data), int(self.line["need"][0]))
        if 2 * needed > len(self._buffer):
            self._set_buffer(4 * needed)
        self._buffer[: len(data)] = np.frombuffer(data, np.uint8)
        self.line["fd"], self.line["end"], self.line["need"] = number, len(data), 0
        for port in self.ports:
            port.line["begin"] = port.line["ahead"] = 0
        for given in self.feed.ports:
            given.queue.clear()

    def release(self) -> list[bytes]:
        """Return the unread bytes to the inlet; the payloads that they contain."""
        begin = min(int(port.line["begin"][0]) for port in self.ports)
        data = self._buffer[begin : int(self.line["end"][0])].tobytes()
        if self.line["fd"][0] >= 0:
            return self.feed.inlet.resume(data)
        # Only whole frames of messages that had waited in the ports: the inlet has its bytes.
        return [body[len(self.topic) :] for _, body in Decoder(LONGEST_FRAME).feed(data)]


class Port:
    """One input of a node."""

    def __init__(self, part: CompiledSegment, entrance: Entrance, wire: Wire) -> None:
        self.entrance, self.wire = entrance, wire
        self.line = np.zeros(1, PORT)
        self.address = self.line.ctypes.data
        self._home = entrance.record
        self._other = blank(entrance.port.kind)
        line = self.line
        line["wire"], line["form"] = wire.line.ctypes.data, wire.form.ctypes.data
        line["row"], line["line"] = entrance.row, entrance.line.ctypes.data
        line["next"], wire.line["port"] = wire.line["port"], self.address
        line["waits"] = entrance.port.waits and not entrance.port.loop
        wire.ports.append(self)
        self._records = {record.ctypes.data: record for record in (self._home, self._other)}
        self._former: list[np.ndarray] = []
        self._set_arenas(ARENA)

    def _set_arenas(self, size: int) -> None:
        self._arenas = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
        self.line["arena"], self.line["other"] = (arena.ctypes.data for arena in self._arenas)
        self.line["space"] = size

    def attach(self) -> None:
        port, line, home = self.entrance.port, self.line, self._home
        need = int(line["need"][0])
        if need > int(line["space"][0]):
            self._former += self._arenas  # the arrays of the present message may be there
            self._set_arenas(2 * need)
        line["need"], line["record"], line["spare"] = 0, home.ctypes.data, self._other.ctypes.data
        message = port.message
        if message is None:
            home["there"] = False
        elif not (home["there"][0] and home["tick"][0] == message.tick):
            self.entrance.write(message)

    def release(self) -> None:
        """Return the message to the port, and its record to where the segment writes it."""
        current, home, port = self._records[int(self.line["record"][0])], self._home, self.entrance.port
        if current is not home:
            home[:] = current
            self.entrance.line["record"] = home.ctypes.data
        if not home["there"][0]:
            port.message = None
        elif port.message is None or port.message.tick != home["tick"][0]:
            port.message = self.entrance.message()
