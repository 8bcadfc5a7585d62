"""Bad days of an emulated device."""

import random
from dataclasses import dataclass
from typing import Annotated

import msgspec

from palpate.drivers.errors import DeviceError

Chance = Annotated[float, "1", msgspec.Meta(ge=0, le=1)]
When = Annotated[float, "s"]


class EmulatedFaults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What goes wrong with an emulated device; the same seed gives the same faults.

    latency   [s]  by which every answer comes later
    dropouts  [1]  chance that an answer is lost
    garbled   [1]  chance that a byte of an answer is wrong
    glitches  [1]  chance that an encoder is far off for one answer
    noise     [1]  chance that an encoder is one count off
    unplug    [s]  after its first answer in the run, when it is pulled out; negative: never
    silent    [s]  after its first answer in the run, when it stops to answer; negative: never
    back      [s]  after its first answer in the run, when it is plugged in again, or answers again; negative: never
    flaky     [1]  attempts to load it, or greetings, that fail before one succeeds
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


@dataclass
class Days:
    """The faults of one device over time. `begun` [ns]: when it first answered; nothing happens before."""

    faults: EmulatedFaults
    begun: int | None = None

    def __post_init__(self) -> None:
        self.random = random.Random(self.faults.seed)

    def begin(self, now: int) -> None:
        """It answers at `now` [ns]; only the first time counts."""
        if self.begun is None:
            self.begun = now

    def _since(self, now: int) -> float:
        return -1.0 if self.begun is None else (now - self.begun) * 1e-9

    def unplugged(self, now: int) -> bool:
        """Whether the plug is out at `now` [ns]."""
        return self._within(self.faults.unplug, now)

    def _within(self, begin: float, now: int) -> bool:
        """Whether `now` [ns] lies between `begin` [s] and the time when it is back."""
        since, back = self._since(now), self.faults.back
        return 0.0 <= begin <= since and not 0.0 <= back <= since

    def lost(self, opened: int, now: int) -> bool:
        """Whether the plug was out since `opened` [ns]: what was opened before stays gone when the device is back."""
        given, then = self.faults, self._since(opened)
        return self.unplugged(now) or (0.0 <= given.unplug <= self._since(now) and then < given.back)

    def check(self, name: str, opened: int, now: int) -> None:
        """DeviceError: the plug was out at some time from `opened` to `now` [ns]."""
        if self.lost(opened, now):
            raise DeviceError(f"the {name} is gone. Plug it in again.", lost=True)

    def silent(self, now: int) -> bool:
        """Whether it has stopped to answer."""
        return self._within(self.faults.silent, now)

    def chance(self, name: str) -> bool:
        """Whether a fault of this name strikes now."""
        odds = getattr(self.faults, name)
        return odds > 0.0 and self.random.random() < odds

    def spoil(self, data: bytes) -> bytes:
        """An answer as it arrives: lost, with a wrong byte, or as it was."""
        if self.chance("dropouts"):
            return b""
        if data and self.chance("garbled"):
            at = self.random.randrange(len(data))
            return data[:at] + bytes((data[at] ^ 1 << self.random.randrange(8),)) + data[at + 1 :]
        return data
