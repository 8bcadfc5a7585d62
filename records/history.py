"""The messages of a stream that somebody may still ask for, by tick."""

from __future__ import annotations

from collections import deque

from palpate.messages import Message

MOST = 65_536
"""Messages kept at most for a reader that asks for none: far more than a logger can bring out of order."""


class History:
    """The last messages of one stream; older than what every reader has used is forgotten."""

    def __init__(self) -> None:
        self.last: Message | None = None
        self.readers: dict[object, int] = {}
        """Of each reader the last tick that it has used."""
        self._messages: dict[int, Message] = {}
        self._ticks: deque[int] = deque()

    def add(self, message: Message) -> None:
        """Take the next message."""
        self.last = message
        self._messages[message.tick] = message
        self._ticks.append(message.tick)
        oldest = min(self.readers.values(), default=message.tick)
        ticks = self._ticks
        while ticks and (ticks[0] < oldest or len(ticks) > MOST):
            del self._messages[ticks.popleft()]

    def at(self, tick: int, reader: object) -> Message | None:
        """The message of this tick, None where there is none."""
        if tick > self.readers.get(reader, -1):
            self.readers[reader] = tick
        return self._messages.get(tick)

    def newest(self, limit: int, reader: object) -> Message | None:
        """The newest message up to tick `limit`."""
        for tick in reversed(self._ticks):
            if tick <= limit:
                return self.at(tick, reader)
        return None
