"""What a network between two parts of a graph does to the messages on one of its edges (docs/delay.md)."""

from __future__ import annotations

import heapq
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages import Message
from palpate.nodes.base import SettingError
from palpate.nodes.base.carrier import Carrier


class Delay(Carrier):
    """Messages of any type, later: each crosses in a time of its own or is lost, as on a network without repeats.

    A message that was sent at t arrives at t + delay + jitter u, u uniform in [-1, 1]; at each tick the newest that has
    arrived is sent on. One that arrives after a newer one is dropped, and while nothing new arrives the last one is
    sent again. Until the first one has arrived both ends agree on how things stood: the message of the first tick is
    sent. The clock is the graph's: times are rounded up to its ticks. Settings:

    delay   that a message takes; jitter: by which it takes more or less, at most `delay`
    loss    chance that a message is lost; the same seed gives the same losses and jitter
    """

    delay: Annotated[float, "s", msgspec.Meta(ge=0, le=60)] = 0.0
    jitter: Annotated[float, "s", msgspec.Meta(ge=0, le=60)] = 0.0
    loss: Annotated[float, "1", msgspec.Meta(ge=0, le=1)] = 0.0
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
        self.tick = -2  # of the last message that was sent; -1 is that of a message outside a graph
        self.crossing: list[tuple[int, int, Message]] = []  # time [ns] of arrival, number, message

    def carry(self, message: Message, dt: float) -> Message | None:
        self.clock += round(dt * 1e9)
        if message.tick != self.tick:
            self.tick, self.sent = message.tick, self.sent + 1
            if not self.loss or self.random.random() >= self.loss:
                late = self.delay + (self.jitter * (2.0 * self.random.random() - 1.0) if self.jitter else 0.0)
                heapq.heappush(self.crossing, (self.clock + round(late * 1e9), self.sent, message))
        arrived = message if self.newest == 0 else None
        self.newest = self.newest or 1
        while self.crossing and self.crossing[0][0] <= self.clock:
            _, number, crossed = heapq.heappop(self.crossing)
            if number >= self.newest:
                self.newest, arrived = number, crossed
        return arrived
