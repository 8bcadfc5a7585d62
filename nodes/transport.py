"""Delay, jitter and loss of messages on an edge of a graph, as in a network (docs/delay.md)."""

import heapq
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages import Message
from palpate.nodes.base import Ideal, SettingError
from palpate.nodes.base.carrier import Carrier


class Delay(Carrier):
    """Delays messages of any type by a random time, and drops some, like a network without retransmission.

    A message that is sent at t arrives at t + delay + jitter u, u uniform in [-1, 1]. At each tick the node sends the
    newest message that has arrived; older ones are dropped, and the last one is repeated until a newer one arrives.
    Until the first arrival it sends the message of the first tick, so both ends start with the same state. A forwarded
    message has tick and time of its forwarding, and the age of its content, so that a contact does not take the jump
    after lost poses for a motion within one tick. The clock is that of the graph; times are rounded up to its ticks.
    Settings:

    delay   mean delay of a message
    jitter  largest deviation from it, at most `delay`
    loss    probability that a message is lost
    seed    of losses and jitter
    """

    delay: Annotated[float, "s", msgspec.Meta(ge=0, le=60)] = 0.0
    jitter: Annotated[float, "s", msgspec.Meta(ge=0, le=60), Ideal("jitter of the network")] = 0.0
    loss: Annotated[float, "1", msgspec.Meta(ge=0, le=1), Ideal("lost messages")] = 0.0
    seed: Annotated[int, "1", msgspec.Meta(ge=0)] = 0

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        if self.jitter > self.delay:
            raise SettingError(
                f"setting 'jitter' [s]: found {self.jitter:g}, expected at most the delay, {self.delay:g}: no message "
                "arrives before it is sent"
            )

    def start(self) -> None:
        self.random = np.random.Generator(np.random.PCG64(self.seed))
        self.clock = self.sent = self.newest = 0
        self.tick = -2  # of the last sent message; -1 is the tick of messages outside a graph
        self.crossing: list[tuple[int, int, int, Message]] = []  # arrival [ns], number, sending [ns], message
        self.last: tuple[int, Message] | None = None  # the one that is forwarded, and when it was sent [ns]

    def carry(self, message: Message, dt: float) -> Message:
        self.clock += round(dt * 1e9)
        if message.tick != self.tick:
            self.tick, self.sent = message.tick, self.sent + 1
            if not self.loss or self.random.random() >= self.loss:
                late = self.delay + (self.jitter * (2.0 * self.random.random() - 1.0) if self.jitter else 0.0)
                heapq.heappush(self.crossing, (self.clock + round(late * 1e9), self.sent, self.clock, message))
        if self.last is None:
            self.newest, self.last = 1, (self.clock, message)
        while self.crossing and self.crossing[0][0] <= self.clock:
            _, number, sent, crossed = heapq.heappop(self.crossing)
            if number >= self.newest:
                self.newest, self.last = number, (sent, crossed)
        sent, forwarded = self.last
        age = (forwarded.delayed or 0) + self.clock - sent
        return msgspec.structs.replace(forwarded, tick=-1, delayed=age or msgspec.UNSET)
