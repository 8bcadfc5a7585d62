"""A table of a motion: time, and position or joint angles."""

import csv
import re
from typing import NamedTuple

import numpy as np

from palpate.messages import DeviceState
from palpate.nodes.base import SettingError

PLACE = ("x", "y", "z")


class Motion(NamedTuple):
    """Rows of a motion."""

    times: np.ndarray  # [s] (n) rising
    values: np.ndarray  # [m] or [rad] (n,k) positions or joint angles
    joints: bool  # [1] whether they are joint angles
    buttons: np.ndarray  # [1] (n)

    def at(self, time: float, repeat: bool = False) -> DeviceState:
        """The state at a time [s] after the first row; after the end the last one, unless `repeat`."""
        begin, end = self.times[0], self.times[-1]
        now = begin + time
        if repeat and now > end > begin:
            now = begin + time % (end - begin)
        values = tuple(float(np.interp(now, self.times, column)) for column in self.values.T)
        row = max(0, int(np.searchsorted(self.times, now, side="right")) - 1)
        pressed = int(self.buttons[row])
        if self.joints:
            return DeviceState(joints=values, buttons=pressed)
        return DeviceState(position=values, buttons=pressed)


def read_motion(path: str) -> Motion:
    """The motion in a CSV. SettingError: the file is invalid; the message names the line."""

    def wrong(text: str) -> SettingError:
        return SettingError(f"setting 'path': {path}: {text}")

    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if row and not row[0].lstrip().startswith("#")]
    except OSError as error:
        raise wrong(f"{error.strerror}") from None
    except UnicodeDecodeError:
        raise wrong("not a text in UTF-8; expected a CSV") from None
    if not rows:
        raise wrong("empty; expected a header such as t,x,y,z and rows of numbers")
    head = [name.strip().lower() for name in rows[0][1]]
    angles = sorted((n for n in head if re.fullmatch(r"joint\d+", n)), key=lambda n: int(n[5:]))
    names = list(PLACE) if set(PLACE) <= set(head) else angles
    if "t" not in head or not names:
        raise wrong(f"its header is {', '.join(head)}; expected t and x, y, z [m], or t and joint1, joint2, ... [rad]")
    numbers = []
    for line, row in rows[1:]:
        try:
            numbers.append([float(cell) for cell in row] + [np.nan] * (len(head) - len(row)))
        except ValueError:
            raise wrong(f"line {line}: found {', '.join(row)!r}, expected numbers") from None
        if len(numbers[-1]) != len(head) or not np.all(np.isfinite(numbers[-1])):
            raise wrong(f"line {line}: found {len(row)} numbers, expected {len(head)} finite ones")
    if not numbers:
        raise wrong("a head without rows")
    table = np.array(numbers)
    times = table[:, head.index("t")]
    if np.any(np.diff(times) <= 0.0):
        bad = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise wrong(f"line {rows[1 + bad][0]}: the time {times[bad]} does not increase")
    values = table[:, [head.index(name) for name in names]]
    buttons = table[:, head.index("buttons")] if "buttons" in head else np.zeros(len(times))
    return Motion(times, values, names is angles, buttons.astype(np.int64))
