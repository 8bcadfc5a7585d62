"""Driver of the Falcon: firmware, homing, then one frame out for each frame in."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from statistics import median_low

from palpate.drivers.connected import PortDriver
from palpate.drivers.errors import DeviceError
from palpate.drivers.falcon import NAME, firmware, frames
from palpate.drivers.frame import SATURATED, FrameRules, absent
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import LIMITS
from palpate.drivers.transport.ftdi import Ftdi, payload
from palpate.physics.device.falcon import FALCON, HOME, forward_kernel

PATIENCE = 0.004  # [s] timeout for an answer
PROBES = 20  # frames sent to see whether firmware runs
JERK = 12  # [counts] largest deviation from the extrapolated angle per ms: 0.4 mm at the grip
UNEVEN = 1.0  # [ms] error of the time between two samples
LARGEST = 120  # [counts] limit of an accepted deviation: about 4 mm
BELIEVED = 4  # consistent samples in a row that are accepted despite a jump
AGREE = 60  # [counts] largest difference of two consistent samples: 2 m/s at 1 kHz

RANGE = (-4096, 4096)
"""[counts] of an encoder: 149 degrees each way. In the box of the device's limits they are between -3811 and 2836."""
JUMPS = "with encoders that jump"
NOWHERE = "with angles at which the arms do not meet"

Counts = tuple[int, int, int]


def encode(values: Counts, status: int = frames.HOMED, number: int = 0, measured: int = 0) -> bytes:
    """A frame: three counts, and the state byte with the homed bits."""
    return frames.report(values, status & 0xF, tuple(bool(status & 0x10 << i) for i in range(3)))  # type: ignore[arg-type]


class FalconDriver(PortDriver[Ftdi]):
    """The device behind an FTDI chip.

    connect   opens the chip
    image     returns the firmware to load if none runs; None: not given
    clock     [ns]
    """

    name = NAME
    limits = LIMITS["falcon"]
    size = 3
    rules = FrameRules(("rad", "m"), encode, good=frames.HOMED, homed=frames.HOMED, counts=RANGE, bridged=BELIEVED - 1)

    def __init__(
        self,
        connect: Callable[[], Ftdi],
        image: Callable[[], bytes] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(connect)
        self.image, self.clock = image, clock
        self.reader = frames.FalconFrameReader()
        self.attempts = 0
        self.glitches = 0

    def open(self) -> None:
        self.geometry = FALCON.geometry
        self.place = HOME
        # Compile now, so that no answer is delayed.
        forward_kernel(self.geometry, FALCON.zero, FALCON.zero, FALCON.zero, *HOME)
        self.last: Counts | None = None
        self.last_at, self.rate = 0, (0.0, 0.0, 0.0)
        self.doubted: list[Counts] = []
        self.rejected = 0
        self.state = frames.HOMING | frames.RED
        self.reader.clear()
        self.port = self.connect()
        firmware.run_mode(self.port)
        self.attempts = 0
        if self._answers():
            return
        if self.image is None:
            raise DeviceError(
                "no firmware runs on the Falcon, and the setting `firmware` names none. It needs the image that came"
                " with its driver (nvent_firmware.bin, also in the source tree of libnifalcon): firmware: path/to/it."
            )
        data = self.image()
        self.attempts = firmware.load(self.port, data, self.clock)
        if not self._answers():
            raise DeviceError(
                f"a firmware of {len(data)} bytes was loaded, but the Falcon sends no frames. Is it a Falcon's image?"
            )

    def _answers(self) -> bool:
        for _ in range(PROBES):
            self.port.write(frames.command((0, 0, 0), frames.HOMING))
            if self._frame() is not None:
                return True
        return False

    def _frame(self) -> bytes | None:
        """The newest complete frame; None after `PATIENCE`."""
        deadline = self.clock() + round(PATIENCE * 1e9)
        while (left := deadline - self.clock()) > 0:
            batch = self.reader.feed(payload(self.port.read(left * 1e-9)))
            if batch:
                return batch[-1]
        return None

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        self.port.write(frames.command(frames.motors(command), self.state))
        frame = self._frame()
        if frame is None:
            return None
        reading = frames.read(frame)
        now = self.clock()
        if not all(reading.homed):
            self.state, self.last, self.rejected = frames.HOMING | frames.RED, None, 0
            return absent(now, reading.buttons)
        self.state = frames.HOMING | frames.GREEN  # the firmware requires that the homing bit stays on
        counts = self._reject_outlier(reading.counts, now)
        if counts is None:
            return absent(now, reading.buttons)
        a, b, c = (FALCON.zero + n * FALCON.count for n in counts)
        ok, x, y, z = forward_kernel(self.geometry, a, b, c, *self.place)
        if not (ok and math.isfinite(x + y + z)):
            self.refused[NOWHERE] += 1
            return absent(now, reading.buttons)
        self.place = x, y, z
        return DeviceSample(self.last_at, (a, b, c), self.place, reading.buttons)

    def _reject_outlier(self, counts: Counts, now: int) -> Counts | None:
        """Outlier rejection: the counts, or the last valid ones (of the time `last_at`) if these are implausible.
        `BELIEVED` consistent samples in a row are accepted; None before the first of them, and after as many that are
        not consistent or not within the range of the encoders.

        The frames have no checksum: a wrong nibble, except the lowest, is an error of at least 16 counts.
        """
        if self.last is not None:
            elapsed = (now - self.last_at) * 1e-6
            missed = max(abs(c - b - r * elapsed) for c, b, r in zip(counts, self.last, self.rate, strict=True))
            if missed <= min(JERK * max(1.0, elapsed) + UNEVEN * max(map(abs, self.rate)), LARGEST):
                if elapsed > 0.0:
                    a, b, c = ((c - b) / max(elapsed, UNEVEN) for c, b in zip(counts, self.last, strict=True))
                    self.rate = a, b, c
                self.last, self.last_at, self.doubted, self.rejected = counts, now, [], 0
                return counts
            self.glitches += 1
        saturated = self.rules.saturated(counts)
        self.rejected += 1
        if self.doubted and max(abs(c - b) for c, b in zip(counts, self.doubted[-1], strict=True)) > AGREE:
            self.doubted = []
        self.doubted.append(counts)
        if saturated:
            self.doubted = []
        if len(self.doubted) >= BELIEVED:
            a, b, c = (median_low(column) for column in zip(*self.doubted, strict=True))  # robust against an outlier
            self.last, self.last_at, self.rate, self.doubted = (a, b, c), now, (0.0, 0.0, 0.0), []
            self.rejected = 0
        elif self.rejected >= BELIEVED:
            self.refused[SATURATED if saturated else JUMPS] += 1
            self.last = None
        return self.last

    def close(self) -> None:
        with suppress(DeviceError):
            self.port.write(frames.command((0, 0, 0), frames.RED))
        super().close()
