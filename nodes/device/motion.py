"""A table of a motion: time, and position or joint angles."""

import csv
import math
import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.messages import DeviceState
from palpate.nodes.base import SettingError
from palpate.physics.readable import MOST_TEXT, check_readable

PLACE = ("x", "y", "z")
UNITS = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "place": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "joint": {"rad": 1.0, "deg": math.pi / 180.0},
    "buttons": {"1": 1.0},
}
"""Units that a header may name, `t [ms]`, by quantity, with their SI values; the first one is the default."""
FARTHEST, LARGEST_ANGLE = 2.0, 4.0 * math.pi
"""[m], [rad] Limits of a motion without a unit in its header: the workspace of no haptic device is larger."""
COARSE, FEW = 0.5, 20
"""[s] Median time between the rows of a longer table than `FEW` rows, from which on its unit must be given."""


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
        check_readable(path, MOST_TEXT)
        with open(path, encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if row and not row[0].lstrip().startswith("#")]
    except OSError as error:
        raise wrong(f"{error.strerror}") from None
    except UnicodeDecodeError:
        raise wrong("not a text in UTF-8; expected a CSV") from None
    if not rows:
        raise wrong("empty; expected a header such as t,x,y,z and rows of numbers")
    head, scales, named = _columns([name.strip().lower() for name in rows[0][1]], wrong)
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
    table = np.array(numbers) * scales
    times = table[:, head.index("t")]
    if np.any(np.diff(times) <= 0.0):
        bad = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise wrong(f"line {rows[1 + bad][0]}: the time {times[bad]} does not increase")
    values = table[:, [head.index(name) for name in names]]
    _check_units(times, values, names, named, wrong)
    buttons = table[:, head.index("buttons")] if "buttons" in head else np.zeros(len(times))
    return Motion(times, values, names is angles, buttons.astype(np.int64))


def _columns(head: list[str], wrong: Callable[[str], SettingError]) -> tuple[list[str], np.ndarray, set[str]]:
    """Names of columns, their factors to SI units, and the names with a unit. SettingError: unknown unit."""
    names, scales, named = [], [], set()
    for cell in head:
        found = re.fullmatch(r"(\w+)\s*[\[(]\s*(.*?)\s*[\])]", cell)
        name, unit = (found[1], found[2]) if found else (cell, "")
        quantity = "place" if name in PLACE else "joint" if re.fullmatch(r"joint\d+", name) else name
        known = UNITS.get(quantity, {})
        if unit and known and unit not in known:
            raise wrong(f"column {cell!r}: found the unit {unit!r}, expected {' or '.join(known)}")
        names.append(name)
        scales.append(known.get(unit, 1.0))
        named |= {name} if unit else set()
    return names, np.array(scales), named


def _check_units(
    times: np.ndarray, values: np.ndarray, names: list[str], named: set[str], wrong: Callable[[str], SettingError]
) -> None:
    """SettingError: implausible values in a column whose header has no unit."""
    angles = names[0] not in PLACE
    most, unit, other = (LARGEST_ANGLE, "rad", "deg") if angles else (FARTHEST, "m", "mm")
    for name, column in zip(names, values.T, strict=True):
        if name not in named and (largest := float(np.abs(column).max())) > most:
            cure = f"name the unit in the header, `{name} [{other}]` or `{name} [{unit}]`"
            raise wrong(f"column {name}: found {largest:.4g} {unit}, expected at most {most:.3g} {unit}; {cure}")
    step = float(np.median(np.diff(times))) if len(times) > FEW else 0.0
    if "t" not in named and step >= COARSE:
        cure = "name the unit in the header, `t [ms]` or `t [s]`"
        raise wrong(f"column t: found rows {step:.3g} s apart, expected less than {COARSE:g} s; {cure}")
