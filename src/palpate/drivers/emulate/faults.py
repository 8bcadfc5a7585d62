"""Faults of an emulated device."""

import random
from typing import Annotated

import msgspec

from palpate.drivers.errors import DeviceError

Chance = Annotated[float, "1", msgspec.Meta(ge=0, le=1)]
When = Annotated[float, "s"]


class EmulatedFaults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Faults of an emulated device; the same seed gives the same faults. Times count from its first answer in the run.

    latency   [s]  delay of every answer
    dropouts  [1]  probability that an answer is lost
    garbled   [1]  probability that a byte of an answer is wrong
    glitches  [1]  probability of a large error of an encoder in one answer
    noise     [1]  probability of an error of one count
    unplug    [s]  time when it is unplugged; negative: never
    silent    [s]  time when it stops answering; negative: never
    back      [s]  time when it is plugged in or answers again; negative: never
    flaky     [1]  number of attempts to load its firmware or greet it that fail before one succeeds
    """

    latency: Annotated[float, "s", msgspec.Meta(ge=0)] = 0.0
    dropouts: Chance = 0.0
    garbled: Chance = 0.0
    glitches: Chance = 0.0
    noise: Chance = 0.0
    unplug: When = -1.0
    silent: When = -1.0
    back: When = -1.0
    flaky: Annotated[int, "1", msgspec.Meta(ge=0)] = 0
    seed: Annotated[int, "1"] = 0


class FaultSchedule:
    """The faults of one device over time. `begun` [ns]: time of its first answer; there are no faults before."""

    def __init__(self, faults: EmulatedFaults) -> None:
        self.faults, self.random = faults, random.Random(faults.seed)
        self.begun: int | None = None

    def begin(self, now: int) -> None:
        """Note an answer at `now` [ns]; only the first one counts."""
        if self.begun is None:
            self.begun = now

    def _since(self, now: int) -> float:
        return -1.0 if self.begun is None else (now - self.begun) * 1e-9

    def is_unplugged(self, now: int) -> bool:
        """Whether the device is unplugged at `now` [ns]."""
        return self._within(self.faults.unplug, now)

    def _within(self, begin: float, now: int) -> bool:
        """Whether `now` [ns] is between `begin` [s] and the time when it is back."""
        since, back = self._since(now), self.faults.back
        return 0.0 <= begin <= since and not 0.0 <= back <= since

    def was_unplugged(self, opened: int, now: int) -> bool:
        """Whether the device was unplugged since `opened` [ns]: a connection does not survive this."""
        given, then = self.faults, self._since(opened)
        return self.is_unplugged(now) or (0.0 <= given.unplug <= self._since(now) and then < given.back)

    def check(self, name: str, opened: int, now: int) -> None:
        """DeviceError: the device was unplugged between `opened` and `now` [ns]."""
        if self.was_unplugged(opened, now):
            raise DeviceError(f"the {name} is gone. Plug it in again.", lost=True)

    def silent(self, now: int) -> bool:
        """Whether it has stopped answering."""
        return self._within(self.faults.silent, now)

    def chance(self, name: str) -> bool:
        """Draw whether a fault of this name occurs now."""
        odds = getattr(self.faults, name)
        return odds > 0.0 and self.random.random() < odds

    def spoil(self, data: bytes) -> bytes:
        """An answer after transmission: lost, with a wrong byte, or unchanged."""
        if self.chance("dropouts"):
            return b""
        if data and self.chance("garbled"):
            at = self.random.randrange(len(data))
            return data[:at] + bytes((data[at] ^ 1 << self.random.randrange(8),)) + data[at + 1 :]
        return data
