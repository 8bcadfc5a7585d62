"""Presses from CSV files: columns with names and units, checks, touch point and zero of the force."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from palpate.models.fit.sessions import HEAD, SessionError, cells_of, numbered_lines, separator_of
from palpate.models.fit.tissue.residuals import inflation

NAMES = {"time": ("time", "t"), "force": ("force", "load", "f"), "indentation": ("indentation", "depth", "compression",
         "approach", "d")}  # fmt: skip
"""Quantity -> default names of its column."""
SI = {"time": "s", "force": "N", "indentation": "m"}
LARGEST = {"time": 1e6, "force": 1e4, "indentation": 0.5}  # Upper bounds in SI units; a larger value means a wrong unit
RIG_COLUMNS = ("indenter", "radius", "diameter", "probe")
"""Columns that identify the indenter; a file with several values mixes several indenters."""
LEAST_ROWS = 10
LEAST_AIR = 8  # Least number of rows before contact from which the zero of the force is estimated
STEEPEST = 0.3  # [1] Rise of the baseline up to the deepest row, over the peak, above which the press begins in contact
LEAST_RISE = 2e-3  # [1] The same ratio below which a drift is negligible
RARE, SUSPECT = 1e-3, 0.2  # p-values below which an effect is significant, and below which it is included in the fit
MOST_ROWS = 1000  # Most rows of a press that are fitted; more rows are averaged in groups of neighbours

Convert = Callable[[str, str], float]
"""(quantity such as '1 mm', SI unit) -> number."""


@dataclass(frozen=True)
class MeasuredPress:
    """One press: time [s] (n,) or None, indentation [m] (n,), force [N] (n,) without its zero.

    touch   [m]  indentation at first contact, estimated from the force; its uncertainty is `slack` [m]
    zero    [N]  mean force before contact, subtracted from `force`; the fit estimates the remaining offset
    drifts  whether the force changes before contact: the fit then includes the slope of the baseline
    air     whether rows before contact show the zero of the force; else the fit searches zero and touch point widely
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

    @cached_property
    def rate(self) -> np.ndarray:
        """[m/s] (n,) of the indentation; 0 without time."""
        return np.zeros(len(self.depth)) if self.time is None else np.gradient(self.depth, self.time)

    @cached_property
    def elapsed(self) -> np.ndarray:
        """[1] (n,) Time from 0 at the first row to 1 at the last; without time, the row number."""
        time = np.arange(len(self.depth), dtype=float) if self.time is None else self.time
        return (time - time[0]) / np.ptp(time)

    def part(self, keep: np.ndarray) -> MeasuredPress:
        """The press with the rows of a mask (n,) only."""
        time = None if self.time is None else self.time[keep]
        return replace(self, time=time, depth=self.depth[keep], force=self.force[keep])


def read_presses(
    path: Path, columns: Mapping[str, str], units: Mapping[str, str], convert: Convert
) -> list[MeasuredPress]:
    """The presses of a file, one for each value of its columns `subject` and `session` if it has them.

    columns  quantity -> its column in the file, with a minus sign to invert its direction
    units    column or quantity -> unit, for a header without units

    SessionError: a fault, with file, row and column.
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
                raise SessionError(f"{where}: found {value:g}, too large for the {key} of a press; is the unit right?")
            values.append(sign * value * factors[key])
        rows.setdefault(" ".join(cells[at] for at in labels if at < len(cells)), []).append(values)
        if rig is not None and rig < len(cells):
            pressed.add(cells[rig].strip())
    if len(pressed) > 1:
        raise SessionError(f"{path}: pressed by {', '.join(sorted(pressed))}: two indenters mixed; fit each separately")
    presses = []
    for session, measured in rows.items():
        name = f"{path.name}{':' if session else ''}{session}"
        table = dict(zip(found, np.array(measured).T, strict=True))
        presses.append(prepared(name, table.get("time"), table["indentation"], table["force"]))
    return presses


def _header(
    path: Path, lines: list[tuple[int, str]], columns: Mapping[str, str]
) -> tuple[int, str, dict[str, tuple[int, str, float]]]:
    """Index of the header line, separator, and quantity -> (column, cell, sign)."""
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
    """Factor from the unit of a column to the SI unit."""
    match = HEAD.fullmatch(cell)
    named = columns.get(key, "").removeprefix("-").strip()
    unit = units.get(key) or units.get(named) or units.get(cell.strip()) or (match["unit"] if match else None)
    if not unit:
        if key == "indentation":
            raise SessionError(f"{path}, column {cell.strip()!r}: no unit; give it with --unit {named or key}=mm")
        return 1.0
    try:
        return convert(f"1 {unit}", SI[key])
    except ValueError as error:
        raise SessionError(f"{path}, column {cell.strip()!r}, unit {unit!r}: {error}") from None


def prepared(name: str, time: np.ndarray | None, depth: np.ndarray, force: np.ndarray) -> MeasuredPress:
    """A press with its touch point and its zero of the force.

    SessionError: too few rows, time that does not increase, no contact, a force of the wrong sign.
    """
    # check rows, order and signs
    if len(depth) < LEAST_ROWS:
        raise SessionError(f"{name}: {len(depth)} rows, expected at least {LEAST_ROWS}")
    if time is not None and (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0))
        raise SessionError(f"{name}: time does not increase: {time[at]:.6g} s is followed by {time[at + 1]:.6g} s")
    if -force.min() > 2.0 * force.max():
        raise SessionError(f"{name}: the force is negative in the press; --columns force=-F inverts it")
    if depth.max() - depth[0] <= 0.2 * np.ptp(depth):
        raise SessionError(f"{name}: the indentation falls in the press; --columns indentation=-d inverts it")
    # noise from second differences (median absolute deviation); detection level of contact
    deepest = int(np.argmax(depth))
    noise = float(np.median(np.abs(np.diff(force, 2)))) / 0.6745 / math.sqrt(6.0)
    line = np.full(len(force), float(np.median(force[: max(deepest // 100, 5)])))
    peak = float((force - line).max())
    if not peak > max(10.0 * noise, 1e-9):
        raise SessionError(f"{name}: never touches: at most {peak:.3g} N with noise of {noise:.2g} N")
    level = max(5.0 * noise, 1e-4 * peak)
    when = np.arange(len(force), dtype=float) if time is None else time - time[0]
    # touch point and baseline depend on each other: iterate to a fixed point
    air, drifts, last = np.zeros(0, int), False, -1
    for _ in range(20):
        apart = np.flatnonzero((force - line)[: deepest + 1] < level)
        before, last = last, int(apart[-1]) if len(apart) else 0
        if last == before:
            break
        # contact begins before the force exceeds the noise; the share of the press is that of Hertz's law
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
        if rise > STEEPEST:  # in contact from the first row
            air = air[:0]
            break
        drifts = sure and rise > LEAST_RISE
        line = offset + slope * when if drifts else np.full(len(force), float(force[seen].mean()))
    touch = float(depth[last]) - 0.5 * back
    free = len(air) >= LEAST_AIR
    zero = float(force[air].mean()) if free else 0.0
    slack = max(back, 0.05 * reach) if free else float(np.ptp(depth))
    press = MeasuredPress(name, time, depth, force - zero, touch, slack, zero, drifts and free, free)
    return press if len(depth) <= MOST_ROWS else _thinned(press)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, bool]:
    """Slope and offset of the regression line through points (n,), and whether the slope may differ from 0.

    The t-test uses the effective number of residuals, since they may be correlated.
    """
    slope, at = np.polyfit(x, y, 1)
    residual = y - at - slope * x
    effective = len(x) / inflation([residual], 2)
    if effective <= 3.0:
        return float(slope), float(at), False
    error = math.sqrt(float(residual @ residual) / len(x) / (effective - 2.0)) / float(x.std())
    return float(slope), float(at), bool(2.0 * student.sf(abs(slope) / max(error, 1e-300), effective - 2.0) < SUSPECT)


def _thinned(press: MeasuredPress) -> MeasuredPress:
    """The press averaged over groups of neighbouring rows, at most `MOST_ROWS` groups."""
    many = -(-len(press.depth) // MOST_ROWS)
    count = len(press.depth) // many

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: count * many].reshape(count, many).mean(axis=1)

    time = None if press.time is None else mean(press.time)
    return replace(press, time=time, depth=mean(press.depth), force=mean(press.force))
