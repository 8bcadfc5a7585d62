"""What the frames of a device say about themselves: whether, when and in which unit the rest of a frame is true.

Each driver declares this as data in `rules`, and checks each frame with `FrameRules.fault`, `FrameOrder` and
`Measured`. A frame that is invalid by its declaration is no sample: the driver answers with `absent`, the guard removes
the force within FALL, and the run counts it in a note. `tests/drivers/test_frame_rules.py` breaks every declared field
of every driver.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate.drivers.guard import SILENT, DeviceSample

LATE, FROZEN, SATURATED, FOREIGN = (
    "late or repeated", "without a new measurement for 20 ms", "with an encoder or gauge at the end of its range",
    "without numbers",
)  # fmt: skip
"""Why a frame is no sample, in addition to its status."""


@dataclass(frozen=True)
class FrameRules:
    """The declaration of a driver.

    units     of the numbers in a sample, in SI
    encode    makes a frame of the device, for tests and emulators: (values, status, number, measured); None: a library
              of the manufacturer reads the frames
    status    what makes the numbers of a frame invalid: bits of its status word, or the name of a flag that must not be
              false; and what that means
    good      status of a valid frame
    valid     the only valid values of the status word; (): all without the bits of `status`
    homed     bits of the status that must be set; without them the device is not homed
    numbers   count of different sequence numbers, after which they begin again; 0: frames have none, and the connection
              keeps their order
    measured  the same for the number or time [us] of the measurement, by which a frozen one is detected; 0: none
    counts    first and last number of an encoder within its range; (): numbers are not limited by their type
    bridged   invalid frames in a row that are replaced by the last valid one, because frames have no checksum
    """

    units: tuple[str, ...]
    encode: Callable[..., Any] | None = None
    status: Mapping[int | str, str] = field(default_factory=dict)
    good: Any = 0
    valid: tuple[int, ...] = ()
    homed: int = 0
    numbers: int = 0
    measured: int = 0
    counts: tuple[int, ...] = ()
    bridged: int = 0

    def fault(self, status: int) -> str:
        """Why the numbers of a frame with this status word are invalid; empty if they are valid."""
        if self.valid and status in self.valid:
            return ""
        named = [text for bits, text in self.status.items() if isinstance(bits, int) and status & bits]
        if not named and self.valid:
            named = ["an unknown error"]
        return f"with status {status:#x}: {', '.join(named)}" if named else ""

    def saturated(self, counts: tuple[int, ...]) -> bool:
        """Whether an encoder is at the end of its range or beyond it."""
        return bool(self.counts) and not all(self.counts[0] <= count <= self.counts[1] for count in counts)


def absent(now: int, buttons: int = 0) -> DeviceSample:
    """The answer of a device whose numbers are invalid at `now` [ns]."""
    return DeviceSample(now, buttons=buttons, homed=False)


class FrameOrder:
    """Accepts each sequence number once and in order, also when the numbers begin again.

    lost  [1]  numbers that were left out
    """

    def __init__(self, rules: FrameRules) -> None:
        self._count, self._last, self.lost = rules.numbers, -1, 0

    def restart(self) -> None:
        """Accept any next number: the device begins to count again."""
        self._last = -1

    def take(self, number: int) -> bool:
        """Whether the frame with this number is newer than the last one. Up to half of the numbers count as newer."""
        if self._last >= 0:
            ahead = (number - self._last) % self._count
            if not 0 < ahead <= self._count // 2:
                return False
            self.lost += ahead - 1
        self._last = number
        return True


class Measured:
    """Detects a frozen measurement while the frames continue. A device that always sends 0 has no number
    or time of its measurements."""

    def __init__(self) -> None:
        self._last, self.since = -1, 0

    def arrival(self, number: int, now: int) -> int:
        """The time [ns] at which the measurement with this number or time arrived; `now` [ns]: that of its frame."""
        if number == 0 or number != self._last:
            self._last, self.since = number, now
        return self.since

    def frozen(self, now: int) -> bool:
        """Whether the last measurement is older than SILENT."""
        return now - self.since > SILENT * 1e9


Refused = Counter[str]
"""Number of frames that were no samples, by reason."""
