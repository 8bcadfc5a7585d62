"""inFORM (MIT's Tangible Media Group): 24 x 24 motorised pins, 96 boards of six on three serial lines.

As its open test program describes it. A message is eight bytes: what it is (246 and above), the board (1 to 96), one
byte for each of its six pins. 246 sends heights, 254 sends them and asks for the pins' own, 253 heads the answer.
Heights lie in 50 .. 210. A block of six pins in a row belongs to one board, in reverse order; boards 5 to 8 of each 12
hang upside down and take 260 - height. Boards 1 to 36 are on the third line, to 60 on the second, others on the first.
"""

import time
from collections.abc import Callable, Sequence
from typing import ClassVar

from palpate.drivers.emulate import EmulatedDevice
from palpate.drivers.errors import DeviceError
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import Limits
from palpate.drivers.transport.serial import SerialLine

NAME = "inFORM"
BAUD = 115200
SIDE, BOARDS, PINS = 24, 96, 6
SEND, ASK, REPLY = 246, 254, 253
LOW, HIGH = 50, 210
TRAVEL = 0.1  # [m] of a pin


def place(row: int, column: int) -> tuple[int, int]:
    """Board (1 to 96) and pin (0 to 5) at a row and column, from the corner across the power supply."""
    group, third = divmod(row, 3)
    return 12 * group + (1, 9, 5)[third] + column // PINS, PINS - 1 - column % PINS


PLACES = {place(row, column): (row, column) for row in range(SIDE) for column in range(SIDE)}


def line_of(board: int) -> int:
    return 2 if board <= 36 else 1 if board <= 60 else 0


def inverted(board: int) -> bool:
    """Whether a board hangs upside down."""
    return (board - 5) % 12 < 4


def message(board: int, heights: Sequence[int], kind: int = SEND) -> bytes:
    """A message to a board: heights LOW .. HIGH as seen from above."""
    return bytes((kind, board, *(LOW + HIGH - h if inverted(board) else h for h in heights)))


def counts(height: float) -> int:
    """The byte of a height [m] above the lowest; held within the travel."""
    return LOW + round(min(max(height / TRAVEL, 0.0), 1.0) * (HIGH - LOW))


class InForm:
    """The display on three lines. A command is 576 heights [m], row by row.

    connect  opens the three lines

    Between two pictures one board after the other is sent its heights again: so a line that is silent is noticed.
    """

    name: ClassVar[str] = NAME
    limits = Limits(TRAVEL, float("inf"), float("inf"))
    size = SIDE * SIDE

    def __init__(self, connect: Callable[[], Sequence[SerialLine]]) -> None:
        self.connect = connect
        self.lines: Sequence[SerialLine] = ()

    def open(self) -> None:
        self.shown: dict[int, bytes] = {}
        self.turn = 0
        self.asked: set[int] = set()  # lines that have not answered yet
        self.rest = [b""] * 3
        self.measured = [0.0] * self.size
        self.lines = self.connect()
        if len(self.lines) != 3:
            raise DeviceError(f"{NAME} has three serial lines, found {len(self.lines)}: port: /dev/a,/dev/b,/dev/c")

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        if not self.lines:
            raise DeviceError(f"{NAME} is not open", lost=True)
        sent = False
        self.turn = self.turn % BOARDS + 1
        for board in range(1, BOARDS + 1):
            heights = [LOW] * PINS
            for pin in range(PINS):
                row, column = PLACES[board, pin]
                heights[pin] = counts(command[row * SIDE + column])
            data = message(board, heights, ASK)
            changed = self.shown.get(board) != data
            if changed or board == self.turn:
                self.lines[line_of(board)].write(data)
                self.asked.add(line_of(board))
                self.shown[board] = data
            sent = sent or changed
        for index, line in enumerate(self.lines):
            self._hear(index, line.read(0.0 if sent else 0.005))
        return None if self.asked else DeviceSample(time.monotonic_ns())

    def _hear(self, index: int, data: bytes) -> None:
        """Take the pins' own heights from the answers."""
        rest = self.rest[index] + data
        while (start := rest.find(REPLY)) >= 0 and len(rest) - start >= 2 + PINS:
            body = rest[start + 1 : start + 2 + PINS]
            rest = rest[start + (2 + PINS if max(body) < SEND else 1) :]
            if max(body) >= SEND or not 1 <= body[0] <= BOARDS:
                continue
            self.asked.discard(index)
            for pin, level in enumerate(body[1:]):
                row, column = PLACES[body[0], pin]
                height = LOW + HIGH - level if inverted(body[0]) else level
                self.measured[row * SIDE + column] = (height - LOW) / (HIGH - LOW) * TRAVEL
        self.rest[index] = rest[-8:]

    def close(self) -> None:
        lines, self.lines = self.lines, ()
        for line in lines:
            line.close()


class EmulatedBoards(EmulatedDevice):
    """The boards on one line. heights: what each pin shows, 0 .. 1, by board."""

    def __init__(self, index: int) -> None:
        self.index = index
        self.heard = b""
        self.raw: dict[int, bytes] = {}
        self.wrong = 0

    def hear(self, data: bytes, now: int) -> list[bytes]:
        self.heard += data
        said = []
        while len(self.heard) >= 2 + PINS:
            kind, board, body = self.heard[0], self.heard[1], self.heard[2 : 2 + PINS]
            if kind not in (SEND, ASK) or max(board, *body) >= SEND:
                self.wrong += 1
                self.heard = self.heard[1:]
                continue
            self.heard = self.heard[2 + PINS :]
            if not 1 <= board <= BOARDS or line_of(board) != self.index:
                continue
            self.raw[board] = body
            if kind == ASK:
                said.append(bytes((REPLY, board)) + body)
        return said
