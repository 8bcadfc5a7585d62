"""Presses from CSV files: named columns with units, what is wrong with them, and where the indenter touches."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from palpate.models.fit.sessions import HEAD, SessionError, cells_of, numbered_lines, separator_of
from palpate.models.fit.tissue.residuals import inflation

NAMES = {"time": ("time", "t"), "force": ("force", "load", "f"), "indentation": ("indentation", "depth", "compression",
         "approach", "d")}  # fmt: skip
"""What is measured, and what its column is called where nothing is said."""
SI = {"time": "s", "force": "N", "indentation": "m"}
LARGEST = {"time": 1e6, "force": 1e4, "indentation": 0.5}
"""Sizes in SI units beyond which a unit must be wrong."""
RIG_COLUMNS = ("indenter", "radius", "diameter", "probe")
"""Columns that say what pressed: more than one value is more than one indenter."""
LEAST_ROWS = 10
LEAST_AIR = 8
"""Rows before the touch from which on they show the zero of force."""
STEEPEST = 0.3
"""[1] Rise of a baseline up to the deepest row, over the peak: more is a press that begins in contact."""
LEAST_RISE = 2e-3
"""[1] The same below which a slope does no harm."""
RARE, SUSPECT = 1e-3, 0.2
"""[1] Probability below which what is seen is not chance; and below which it is searched for."""
MOST_ROWS = 1000
"""Rows of a press that are fitted: of more, means of neighbours."""

Convert = Callable[[str, str], float]
"""(quantity such as '1 mm', SI unit) -> number."""


@dataclass(frozen=True)
class Press:
    """One press: time [s] (n,) or None, indentation [m] (n,), force [N] (n,) less its zero.

    touch   [m]  where it begins to touch, as the force shows it; uncertain by `slack` [m]
    zero    [N]  mean force before, taken off; what is left of it is found with the parameters
    drifts  whether the force seems to change before the touch already: the slope of its baseline is found as well
    air     whether rows before the touch show the zero of force; else zero and touch point are searched far and wide
    """

    name: str
    time: np.ndarray | None
    depth: np.ndarray
    force: np.ndarray
    touch: float
    slack: float
    zero: float
    drifts: bool = False
    air: bool = True

    @property
    def rate(self) -> np.ndarray:
        """[m/s] (n,) of the indentation; 0 without time."""
        return np.zeros(len(self.depth)) if self.time is None else np.gradient(self.depth, self.time)

    @property
    def elapsed(self) -> np.ndarray:
        """[1] (n,) Share of the record, 0 at its first row and 1 at its last; without time by rows."""
        time = np.arange(len(self.depth), dtype=float) if self.time is None else self.time
        return (time - time[0]) / np.ptp(time)

    def part(self, keep: np.ndarray) -> Press:
        """The rows (n,) bool."""
        time = None if self.time is None else self.time[keep]
        return replace(self, time=time, depth=self.depth[keep], force=self.force[keep])


def read_presses(path: Path, columns: Mapping[str, str], units: Mapping[str, str], convert: Convert) -> list[Press]:
    """The presses of a file, one for each value of its columns `subject` and `session` where it has them.

    columns  quantity -> its column in the file, with a minus before one that counts the other way
    units    column or quantity -> unit, for a header that has none

    SessionError: what is wrong, with file, row and column.
    """
    lines = numbered_lines(path)
    at, separator, found = _header(path, lines, columns)
    factors = {key: _factor(path, key, cell, columns, units, convert) for key, (_, cell, _) in found.items()}
    rows: dict[str, list[list[float]]] = {}
    pressed: set[str] = set()
    header = cells_of(path, *lines[at], separator)
    heads = {m["name"].lower(): i for i, cell in enumerate(header) if (m := HEAD.fullmatch(cell))}
    labels = [heads[name] for name in ("subject", "session") if name in heads]
    rig = next((heads[name] for name in RIG_COLUMNS if name in heads), None)
    for number, line in lines[at + 1 :]:
        cells = cells_of(path, number, line, separator)
        values = []
        for key, (place, cell, sign) in found.items():
            where = f"{path}, row {number}, column {cell.strip()!r}"
            try:
                value = float(cells[place])
            except (IndexError, ValueError):
                shown = cells[place] if place < len(cells) else ""
                raise SessionError(f"{where}: found {shown!r}, expected a number with a decimal point") from None
            if not math.isfinite(value):
                raise SessionError(f"{where}: found {cells[place].strip()!r}, expected a finite number")
            if abs(value * factors[key]) > LARGEST[key]:
                raise SessionError(f"{where}: found {value:g}, which is no {key} of a press; is the unit right?")
            values.append(sign * value * factors[key])
        rows.setdefault(" ".join(cells[at] for at in labels if at < len(cells)), []).append(values)
        if rig is not None and rig < len(cells):
            pressed.add(cells[rig].strip())
    if len(pressed) > 1:
        raise SessionError(f"{path}: pressed by {', '.join(sorted(pressed))}: two indenters mixed; fit each by itself")
    presses = []
    for session, measured in rows.items():
        name = f"{path.name}{':' if session else ''}{session}"
        table = dict(zip(found, np.array(measured).T, strict=True))
        presses.append(prepared(name, table.get("time"), table["indentation"], table["force"]))
    return presses


def _header(
    path: Path, lines: list[tuple[int, str]], columns: Mapping[str, str]
) -> tuple[int, str, dict[str, tuple[int, str, float]]]:
    """The line of the header, what parts its cells, and quantity -> (place, cell, sign)."""
    best: tuple[str, list[str]] = ("", [])
    for at, (number, line) in enumerate(lines[:60]):
        separator = separator_of(line)
        cells = cells_of(path, number, line, separator)
        found: dict[str, tuple[int, str, float]] = {}
        for key, names in NAMES.items():
            wanted = columns.get(key, "")
            sign = -1.0 if wanted.startswith("-") else 1.0
            wanted = wanted.removeprefix("-").strip()
            for place, cell in enumerate(cells):
                match = HEAD.fullmatch(cell)
                name = match["name"] if match else cell
                if (wanted and wanted in (cell.strip(), name)) or (not wanted and name.lower() in names):
                    found.setdefault(key, (place, cell, sign))
        if {"force", "indentation", *columns} <= found.keys():
            return at, separator, found
        if len(found) > len(best[1]) or not best[0]:
            best = (line, sorted({"force", "indentation", *columns} - found.keys()))
    raise SessionError(
        f"{path}: no header with a column for {' and '.join(best[1]) or 'force and indentation'}; found "
        f"{best[0].strip()[:120]!r}. Name them: --columns time=t,force=F,indentation=d"
    )


def _factor(
    path: Path, key: str, cell: str, columns: Mapping[str, str], units: Mapping[str, str], convert: Convert
) -> float:
    """SI units in the unit of a column."""
    match = HEAD.fullmatch(cell)
    named = columns.get(key, "").removeprefix("-").strip()
    unit = units.get(key) or units.get(named) or units.get(cell.strip()) or (match["unit"] if match else None)
    if not unit:
        if key == "indentation":
            raise SessionError(f"{path}, column {cell.strip()!r}: no unit; say it with --unit {named or key}=mm")
        return 1.0
    try:
        return convert(f"1 {unit}", SI[key])
    except ValueError as error:
        raise SessionError(f"{path}, column {cell.strip()!r}, unit {unit!r}: {error}") from None


def prepared(name: str, time: np.ndarray | None, depth: np.ndarray, force: np.ndarray) -> Press:
    """A press with its touch point and its zero of force.

    SessionError: too few rows, time that does not grow, no touch, a force of the wrong sign.
    """
    if len(depth) < LEAST_ROWS:
        raise SessionError(f"{name}: {len(depth)} rows, expected at least {LEAST_ROWS}")
    if time is not None and (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0))
        raise SessionError(f"{name}: time does not grow: {time[at]:.6g} s is followed by {time[at + 1]:.6g} s")
    if -force.min() > 2.0 * force.max():
        raise SessionError(f"{name}: the force is negative in the press; --columns force=-F counts it the other way")
    if depth.max() - depth[0] <= 0.2 * np.ptp(depth):
        raise SessionError(f"{name}: the indentation falls in the press; --columns indentation=-d counts it so")
    deepest = int(np.argmax(depth))
    noise = float(np.median(np.abs(np.diff(force, 2)))) / 0.6745 / math.sqrt(6.0)
    line = np.full(len(force), float(np.median(force[: max(deepest // 100, 5)])))
    peak = float((force - line).max())
    if not peak > max(10.0 * noise, 1e-9):
        raise SessionError(f"{name}: never touches: at most {peak:.3g} N, and noise of {noise:.2g} N")
    level = max(5.0 * noise, 1e-4 * peak)
    when = np.arange(len(force), dtype=float) if time is None else time - time[0]
    air, drifts, last = np.zeros(0, int), False, -1
    for _ in range(20):  # the touch point needs the baseline, and the baseline what is before the touch point
        apart = np.flatnonzero((force - line)[: deepest + 1] < level)
        before, last = last, int(apart[-1]) if len(apart) else 0
        if last == before:
            break
        # the force rises out of the noise later than it touches, by Hertz's law by this share of the press
        reach = float(depth[deepest] - depth[last])
        share = min(level / peak, 0.3) ** (2.0 / 3.0)
        back = reach * share / (1.0 - share)
        clear = (depth[:last] < depth[last] - 1.5 * back) | ((depth[:last] == 0.0) & (force[:last] == 0.0))
        air = np.flatnonzero(clear)
        if last < LEAST_AIR:
            break
        seen = air if len(air) >= LEAST_AIR else np.arange(last)
        slope, offset, sure = _line(when[seen], force[seen])
        rise = abs(slope) * float(when[deepest] - when[0]) / peak
        if rise > STEEPEST:  # it touches already
            air = air[:0]
            break
        drifts = sure and rise > LEAST_RISE
        line = offset + slope * when if drifts else np.full(len(force), float(force[seen].mean()))
    touch = float(depth[last]) - 0.5 * back
    free = len(air) >= LEAST_AIR
    zero = float(force[air].mean()) if free else 0.0
    slack = max(back, 0.05 * reach) if free else float(np.ptp(depth))
    press = Press(name, time, depth, force - zero, touch, slack, zero, drifts and free, free)
    return press if len(depth) <= MOST_ROWS else _thinned(press)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, bool]:
    """Slope and offset of the line through points (n,), and whether its slope may differ from 0; the residuals may
    be correlated."""
    slope, at = np.polyfit(x, y, 1)
    off = y - at - slope * x
    effective = len(x) / inflation([off], 2)
    if effective <= 3.0:
        return float(slope), float(at), False
    error = math.sqrt(float(off @ off) / len(x) / (effective - 2.0)) / float(x.std())
    return float(slope), float(at), bool(2.0 * student.sf(abs(slope) / max(error, 1e-300), effective - 2.0) < SUSPECT)


def _thinned(press: Press) -> Press:
    """Means of as many neighbours as leave `MOST_ROWS` at most."""
    many = -(-len(press.depth) // MOST_ROWS)
    count = len(press.depth) // many

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: count * many].reshape(count, many).mean(axis=1)

    time = None if press.time is None else mean(press.time)
    return replace(press, time=time, depth=mean(press.depth), force=mean(press.force))
