"""A table of a motion: time, and position or joint angles."""

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from palpate.messages import DeviceState
from palpate.nodes.base import SettingError
from palpate.physics.table_file import COARSE, Table, coarse_step, read_table
from palpate.units.header import examples, split_unit

PLACE = ("x", "y", "z")
SI = {"t": "s", "place": "m", "joint": "rad"}
"""SI units by quantity, which are those of a header without units."""
FARTHEST, LARGEST_ANGLE = 2.0, 4.0 * math.pi
"""[m], [rad] Limits of a motion without a unit in its header: the workspace of no haptic device is larger."""


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


def read_motion(path: str, dialect: str = "") -> Motion:
    """The motion in a table of any form that `physics.table_file` reads. SettingError: the file is invalid.

    dialect  of the numbers, if it cannot be detected: one of `table_numbers.DIALECTS`
    """

    def wrong(text: str) -> SettingError:
        text = text.replace("Set --dialect ", "Set dialect to ").replace("--dialect", "setting 'dialect'")
        return SettingError(f"setting 'path': {path}: {text}")

    def score(cells: Sequence[str]) -> int:
        names = {split_unit(cell)[0].lower() for cell in cells}
        return ("t" in names) + ("joint1" in names or set(PLACE) <= names)

    try:
        found = read_table(path, score, 2, dialect)
    except OSError as error:
        raise wrong(f"{error.strerror}") from None
    except ValueError as error:
        if str(error) == "empty":
            raise wrong("empty; expected a header such as t,x,y,z and rows of numbers") from None
        raise wrong(f"{error}; expected a CSV") from None
    head = _columns(found, wrong)
    angles = sorted((n for n in head if re.fullmatch(r"joint\d+", n)), key=lambda n: int(n[5:]))
    names = list(PLACE) if set(PLACE) <= set(head) else angles
    if "t" not in head or not names:
        raise wrong(f"its header is {', '.join(head)}; expected t and x, y, z [m], or t and joint1, joint2, ... [rad]")
    if not found.rows:
        raise wrong("a header without rows")
    used = ["t", *names, *(["buttons"] if "buttons" in head else [])]
    try:
        read, lines = found.values([head.index(name) for name in used], head.index("t"))
        scales = {name: found.factor(head.index(name), SI[_quantity(name)]) for name in ("t", *names)}
    except ValueError as error:
        raise wrong(f"{error}") from None
    named = {name for name, scale in scales.items() if scale is not None}
    table = dict(zip(used, (read * [scales.get(name) or 1.0 for name in used]).T, strict=True))
    times = table["t"]
    if np.any(np.diff(times) <= 0.0):
        bad = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise wrong(f"row {lines[bad]}: the time {times[bad]} s does not increase")
    values = np.stack([table[name] for name in names], axis=1)
    _check_units(times, values, names, named, wrong)
    buttons = table.get("buttons", np.zeros(len(times)))
    return Motion(times, values, names is angles, buttons.astype(np.int64))


def _quantity(name: str) -> str:
    """The quantity of a column."""
    return "place" if name in PLACE else "joint" if re.fullmatch(r"joint\d+", name) else name


def _columns(table: Table, wrong: Callable[[str], SettingError]) -> list[str]:
    """Names of the columns. SettingError: two columns with a name that is read."""
    names = [name.lower() for name in table.names]
    for name in names:
        if (_quantity(name) in SI or name == "buttons") and names.count(name) > 1:
            raise wrong(f"row {table.line}: two columns {name!r}; expected one")
    return names


def _check_units(
    times: np.ndarray, values: np.ndarray, names: list[str], named: set[str], wrong: Callable[[str], SettingError]
) -> None:
    """SettingError: implausible values in a column whose header has no unit."""
    angles = names[0] not in PLACE
    most, unit = (LARGEST_ANGLE, "rad") if angles else (FARTHEST, "m")
    for name, column in zip(names, values.T, strict=True):
        if name not in named and (largest := float(np.abs(column).max())) > most:
            cure = f"name the unit in the header: `{name} [UNIT]`, with {examples(unit)} or another as UNIT"
            raise wrong(f"column {name}: found {largest:.4g} {unit}, expected at most {most:.3g} {unit}; {cure}")
    if "t" not in named and (step := coarse_step(times)):
        cure = f"name the unit in the header: `t [UNIT]`, with {examples('s')} or another as UNIT"
        raise wrong(f"column t: found rows {step:.3g} s apart, expected less than {COARSE:g} s; {cure}")
