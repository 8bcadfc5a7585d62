"""The clock of the launcher, as a worker on another machine sees it."""

from collections import deque

from palpate.engine import clock

KEPT = 8  # differences, those of 4 s, in which two clocks drift apart by 0.4 ms at most
STEP = 100_000  # [ns] of a correction, two in a second, as clocks differ by up to 100 ppm


class FarClock:
    """The launcher's monotonic clock, read by that of this machine.

    Two machines have unrelated zeros of these clocks, as each counts from its start, and their rates differ by up to
    100 ppm, 0.4 s in an hour. The launcher sends its time with the order to start and with its heartbeats. What this
    clock shows when an order is read, less that time, is the difference of the clocks and the delay of the order.
    The delay is not known, so the smallest difference of the last `KEPT` orders is taken: times are late here by
    the shortest delay among them, about 0.1 ms in a wired network.
    """

    def __init__(self) -> None:
        self._differences: deque[int] = deque(maxlen=KEPT)
        self._zero = 0  # [ns] time of tick 0 on the launcher's clock

    def hear(self, sent: int) -> None:
        """An order is read that the launcher sent at this time [ns] of its clock."""
        self._differences.append(clock.now() - sent)

    def begin(self, moment: int) -> int:
        """The time here of tick 0, which is `moment` on the launcher's clock [ns]."""
        self._zero = moment
        return self._origin()

    def corrected(self, origin: int) -> int:
        """The time of tick 0 [ns], after this one was used: a correction of at most `STEP` leaves no tick out."""
        return origin + max(-STEP, min(STEP, self._origin() - origin))

    def _origin(self) -> int:
        return self._zero + min(self._differences)
