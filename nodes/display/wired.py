"""Real pin displays, driven by `Pins`."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.drivers.exchange import Driver
from palpate.drivers.guard import DeviceSample, Guard
from palpate.messages import Pins
from palpate.nodes.base.wired import EMULATOR, Wired


class Still(Guard):
    """For a display that shows heights: it keeps its last picture, and is flat when the graph ends."""

    def apply(self, command: tuple[float, ...], now: int, given: int) -> tuple[float, ...]:
        return command

    def saw(self, sample: DeviceSample | None) -> None:
        pass


class _Shown(Wired):
    """What both displays share: the picture in the middle of the pins, and what it shows before the first one."""

    effect = "display"

    rows: Annotated[int, "1", msgspec.Meta(ge=1, le=1000)]
    columns: Annotated[int, "1", msgspec.Meta(ge=1, le=1000)]

    def guard(self, driver: Driver) -> Guard:
        return Still(driver.limits)

    def picture(self, heights: np.ndarray, rest: float) -> np.ndarray:
        """Heights [m] in the middle of all pins (rows,columns), the others at rest [m]; what is too large is cut."""
        shown = np.full((self.rows, self.columns), rest)
        height, width = (min(a, b) for a, b in zip(heights.shape, shown.shape, strict=True))
        top, left = (self.rows - height) // 2, (self.columns - width) // 2
        y, x = (heights.shape[0] - height) // 2, (heights.shape[1] - width) // 2
        shown[top : top + height, left : left + width] = heights[y : y + height, x : x + width]
        return shown


class InForm(_Shown):
    """inFORM: 24 x 24 pins of 100 mm on three serial lines. `port`: the three, comma between; `emulator`: none at all.

    rest   height at which a pin stands for 0
    scale  height of a pin for one metre of `Pins.heights`: its pins lie further apart than a fingerpad's
    """

    rows: Annotated[int, "1", msgspec.Meta(ge=24, le=24)] = 24
    columns: Annotated[int, "1", msgspec.Meta(ge=24, le=24)] = 24
    rest: Annotated[float, "m", msgspec.Meta(ge=0, le=0.1)] = 0.05
    scale: Annotated[float, "1"] = 10.0

    def driver(self) -> Driver:
        from palpate.drivers.emulate.line import EmulatedLine
        from palpate.drivers.pins import inform
        from palpate.drivers.transport.serial import SerialLine

        if self.port == EMULATOR:
            lines = [EmulatedLine(inform.EmulatedBoards(i), inform.BAUD, inform.NAME, self.faults) for i in range(3)]
            return inform.InForm(lambda: [line.connect() for line in lines])
        ports = [port.strip() for port in self.port.split(",")]
        return inform.InForm(lambda: [SerialLine(port, inform.BAUD, inform.NAME) for port in ports])

    def step(self, pins: Pins, *, dt: float) -> None:
        shown = self.picture(self.rest + self.scale * np.asarray(pins.heights), self.rest)
        self.talk(tuple(shown.ravel().tolist()), dt)


class DotPad(_Shown):
    """Dot Pad: 60 x 40 dots that are up or down. `port`: its serial port; `emulator`: none at all.

    threshold  height from which on a dot is up; none given: half way between the lowest and the highest of the picture
    repeat     dots along each side that show one pin
    """

    rows: Annotated[int, "1", msgspec.Meta(ge=4, le=400)] = 40
    columns: Annotated[int, "1", msgspec.Meta(ge=2, le=400)] = 60
    threshold: Annotated[float | None, "m"] = None
    repeat: Annotated[int, "1", msgspec.Meta(ge=1, le=60)] = 4

    def driver(self) -> Driver:
        from palpate.drivers.emulate.line import EmulatedLine
        from palpate.drivers.pins import dotpad
        from palpate.drivers.transport.serial import SerialLine

        if self.port == EMULATOR:
            device = dotpad.EmulatedDotPad(self.rows, self.columns)
            line = EmulatedLine(device, dotpad.BAUD, dotpad.NAME, self.faults)
            return dotpad.DotPad(line.connect, self.rows, self.columns)
        return dotpad.DotPad(lambda: SerialLine(self.port, dotpad.BAUD, dotpad.NAME), self.rows, self.columns)

    def step(self, pins: Pins, *, dt: float) -> None:
        heights = np.asarray(pins.heights)
        level = 0.5 * (heights.min() + heights.max()) if self.threshold is None else self.threshold
        up = np.kron(heights > level, np.ones((self.repeat, self.repeat))).astype(float)
        self.talk(tuple(self.picture(up, 0.0).ravel().tolist()), dt)
