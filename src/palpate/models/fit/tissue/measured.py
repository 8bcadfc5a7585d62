"""Presses from CSV files: columns with names and units, checks, touch point and zero of the force."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import check_one_indenter, check_unnamed_bodies, row_labels
from palpate.models.fit.tissue.noise import noise_before, step_of
from palpate.models.fit.tissue.residuals import inflation
from palpate.models.fit.tissue.table import (
    WITHOUT_TIME,
    check_time,
    columns_of,
    inverting,
    numbers_of,
    specimen_column,
    table_of,
)

MOST_REPEATED = 0.01  # [1] Largest share of rows that repeat the time stamp of the row before
LEAST_ROWS = 10
BACK = 0.5  # [1] Fall of the indentation between two rows, over its range, from which another press begins
LEAST_AIR = 8  # Least number of rows before contact from which the zero of the force is estimated
STEEPEST = 0.3  # [1] Rise of the baseline up to the deepest row, over the peak, above which the press begins in contact
MOST_RISE = (
    0.1  # [1] Force at touch, over the peak, up to which it is a rise before contact, and not the begin of a law
)
LEAST_RISE = 2e-3  # [1] The same ratio below which a drift is negligible
RARE, SUSPECT = 1e-3, 0.2  # p-values below which an effect is significant, and below which it is included in the fit
TRAVEL = 0.9  # [1] Quantile of the travel between rows within which two cycles are equally deep
GRID = np.geomspace(1.0, 2e-3, 60)  # [1] Shares of the travel in contact at which a touch point is tried
LEAST_CONTACT, AIR_ROWS = 100, 300
"""Rows in contact below which a long approach is cut instead of averaging all rows, and its least rows then."""
MOST_ROWS = 1000  # Most rows of a press that are fitted; more rows are averaged in groups of neighbours


@dataclass(frozen=True)
class Rise:
    """An exponential rise of the force before contact, up to the touch point of the fit.

    length, approach  [m]  of the rise, and of the approach
    free    whether the length is an unknown of the fit, which begins at `length`
    """

    length: float
    approach: float
    free: bool = False


@dataclass(frozen=True)
class Hum:
    """A line in the noise: sine sin(x) + cosine cos(x), x = 2 pi cycles t/(duration of the rows).

    sine, cosine  [N]
    """

    cycles: float
    sine: float
    cosine: float


@dataclass(frozen=True)
class MeasuredPress:
    """One press: time [s] (n,) or None, indentation [m] (n,), force [N] (n,) without its zero.

    touch   [m]  indentation at first contact, estimated from the force; its uncertainty is `slack` [m]
    zero    [N]  mean force before contact, subtracted from `force`; the fit estimates the remaining offset
    drifts, bends  whether the fit includes a baseline that is linear, and one that is quadratic in time
    rise    of the force before contact that the fit includes
    hum     of the sensor that the fit includes
    step    [N]  of the converter of the force; 0: no repeated values show one
    remarks  which columns were read, and which lines were not
    specimen  what is pressed, as the file names it; "": it does not
    averaged  rows of the file that each row is the mean of
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
    bends: bool = False
    air: bool = True
    remarks: tuple[str, ...] = ()
    step: float = 0.0
    rise: Rise | None = None
    hum: Hum | None = None
    specimen: str = ""
    averaged: int = 1

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
    path: Path, columns: Mapping[str, str], units: Mapping[str, str], dialect: str = ""
) -> list[MeasuredPress]:
    """The presses of a file, one for each value of the columns that name a press or a specimen (`specimens`).

    columns  quantity -> its column in the file, by name or number from 1, with a minus sign to invert its direction;
             "" leaves the time out. `specimen` names the column of the specimens; "": all rows are of one
    units    column or quantity -> unit, for a header without units
    dialect  of the numbers, if it cannot be detected: one of `table_file.DIALECTS`

    SessionError: a fault, with file, row and column.
    """
    table = table_of(path, columns, dialect)
    found = columns_of(path, table, columns)
    check_one_indenter(path, table)
    values, lines, shown = numbers_of(path, table, found, columns, units)
    depths, named = values[:, list(found).index("indentation")], specimen_column(path, table, columns)
    labels, specimens = row_labels(table, lines, depths, named, columns.get("specimen") == "")
    if len(set(labels)) < 2 and "specimen" not in columns:
        check_unnamed_bodies(path, table, [k for k, _ in found.values()], depths)
    sessions = np.array(labels)
    remarks = (f"{path.name}: {', '.join(shown)}", *(f"{path.name}: {text}" for text in table.skipped))
    presses: list[MeasuredPress] = []
    for session in dict.fromkeys(sessions.tolist()):
        name, rows = f"{path.name}{':' if session else ''}{session}", np.flatnonzero(sessions == session)
        parts = dict(zip(found, values[rows].T, strict=True))
        _check_one_press(name, parts["indentation"], [lines[k] for k in rows])
        time, repeated = _one_per_stamp(name, parts.get("time"), [lines[k] for k in rows])
        first = specimens[rows[0]] not in {press.specimen for press in presses}
        notes = remarks if first else ()
        if len(repeated):
            stamps = ", ".join(str(lines[rows[k]]) for k in repeated)
            notes = (*notes, f"{name}: row {stamps} repeats the time of the row before, and is left out")
        depth, force = (np.delete(parts[key], repeated) for key in ("indentation", "force"))
        cure = partial(inverting, found)
        press = prepare_press(name, time, depth, force, cure)
        presses.append(replace(press, remarks=notes, specimen=specimens[rows[0]]))
    if "time" in found:
        check_time(path, table, found["time"][0], values[:, list(found).index("time")], columns, units)
    return presses


def _check_one_press(name: str, depth: np.ndarray, lines: list[int]) -> None:
    """SessionError: the depth returns in a single row from one press to the begin of the next one."""
    fall = -np.diff(depth)
    if len(depth) >= LEAST_ROWS and fall.max() > BACK * np.ptp(depth):
        at = int(np.argmax(fall))
        raise SessionError(
            f"{name}, row {lines[at + 1]}: the indentation falls from {1e3 * depth[at]:.3g} to "
            f"{1e3 * depth[at + 1]:.3g} mm in one row: two presses? Name them in a column `press`, or save each in "
            "its file"
        )


def _one_per_stamp(name: str, time: np.ndarray | None, lines: list[int]) -> tuple[np.ndarray | None, np.ndarray]:
    """Time without single repeated stamps, and their rows. SessionError: time falls, or its clock is too coarse."""
    if time is None:
        return None, np.zeros(0, int)
    step = np.diff(time)
    repeated = np.flatnonzero(step == 0.0) + 1
    few = len(repeated) <= max(1, int(MOST_REPEATED * len(time)))
    wrong = np.flatnonzero(step < 0.0) if few else repeated - 1
    if len(wrong):
        at = int(wrong[0])
        more = "" if few else f" ({len(repeated)} of {len(time)} rows repeat a time: the resolution is too low)"
        raise SessionError(
            f"{name}, row {lines[at + 1]}: time does not increase: {time[at]:.6g} s is followed by "
            f"{time[at + 1]:.6g} s{more}; {WITHOUT_TIME}"
        )
    return np.delete(time, repeated), repeated


def prepare_press(
    name: str, time: np.ndarray | None, depth: np.ndarray, force: np.ndarray,
    inverted: Callable[[frozenset[str]], str] = lambda names: "",
) -> MeasuredPress:  # fmt: skip
    """A press with its touch point and its zero of the force.

    inverted  the remedy if these of `force` and `indentation` have the wrong sign

    SessionError: too few rows, time that does not increase, no contact, a force of the wrong sign.
    """
    # check rows, order and signs
    if len(depth) < LEAST_ROWS:
        raise SessionError(f"{name}: {len(depth)} rows, expected at least {LEAST_ROWS}")
    if time is not None and (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0))
        raise SessionError(f"{name}: time does not increase: {time[at]:.6g} s is followed by {time[at + 1]:.6g} s")
    _check_signs(name, time, depth, force, inverted)
    # noise from second differences (median absolute deviation); detection level of contact
    deepest = deepest_row(depth)
    noise, step = noise_before(force), step_of(force)
    line = np.full(len(force), float(np.median(force[: max(deepest // 100, 5)])))
    peak = float((force - line).max())
    if not peak > max(10.0 * noise, 1e-13):
        raise SessionError(f"{name}: never touches: at most {peak:.3g} N with noise of {noise:.2g} N")
    level = max(5.0 * noise, 1e-4 * peak, 1.5 * step)
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
    later = hertz_touch(when[: deepest + 1], depth[: deepest + 1], force[: deepest + 1], touch) if free else touch
    rise = float((force - line)[int(np.argmax(depth >= later))])
    if later - touch > 2.0 * slack and rise < MOST_RISE * peak:
        # a rise before contact, or a law of another curvature: allow for both
        touch, slack = later, later - touch
    # a drift below the noise before contact may still matter at the peak: fit one in each press that has these rows
    return MeasuredPress(name, time, depth, force - zero, touch, slack, zero, drifts=free, air=free, step=step)


def deepest_row(depth: np.ndarray) -> int:
    """The deepest row of a press (n,). If several cycles are equally deep within the travel of a row, that of the first
    one: a tissue is softer in the cycles after it, and which row is deepest depends on noise."""
    top = int(np.argmax(depth))
    rises = np.diff(depth[: top + 1])
    rises = rises[rises > 0.0]
    if not len(rises):
        return top
    near = depth >= depth[top] - np.quantile(rises, TRAVEL)
    first = int(np.argmax(near))
    left = np.flatnonzero(depth[first:] < depth[top] - 0.5 * (depth[top] - float(depth.min())))
    return first + int(np.argmax(depth[first : first + left[0]])) if len(left) else top


def hertz_touch(when: np.ndarray, depth: np.ndarray, force: np.ndarray, first: float) -> float:
    """The depth [m] of touch, not before `first`, at which Hertz's law on a linear baseline leaves the least squares.

    The first row above the noise may lie far before contact, where the force rises slowly: long-range forces, hair, a
    film of water. Rows (n,) of a loading; touch points are searched on a logarithmic grid before the deepest row.
    """
    reach = float(depth[-1]) - first
    rows = np.stack([np.ones(len(when)), when / max(float(np.ptp(when)), 1e-300)], axis=1)
    basis = np.linalg.qr(rows)[0]
    rest = force - basis @ (basis.T @ force)
    best = (0.0, first)
    for share in GRID:
        curve = np.maximum(depth - (float(depth[-1]) - share * reach), 0.0) ** 1.5
        curve = curve - basis @ (basis.T @ curve)
        size = float(curve @ curve)
        if np.count_nonzero(curve) and size > 0.0:
            best = max(best, (float(curve @ rest) ** 2 / size, float(depth[-1]) - share * reach))
    return best[1]


def _check_signs(
    name: str, time: np.ndarray | None, depth: np.ndarray, force: np.ndarray, inverted: Callable[[frozenset[str]], str]
) -> None:
    """SessionError: force or indentation fall in the press. The remedy is printed only if it gives a press."""
    deepest = deepest_row(depth)
    first = float(np.median(force[: max(len(force) // 100, 5)]))
    pressed = force[: deepest + 1] - first
    if depth[deepest] - depth[0] <= 0.2 * np.ptp(depth):
        what, signs = "indentation", ((-1.0, 1.0), (-1.0, -1.0))
    elif -pressed.min() > 2.0 * pressed.max():
        what, signs = "force", ((1.0, -1.0), (-1.0, -1.0))
    else:
        return
    for one, other in signs:
        try:
            prepare_press(name, time, one * depth, other * force)
        except SessionError:
            continue
        wrong = frozenset({"indentation"} if one < 0.0 else ()) | frozenset({"force"} if other < 0.0 else ())
        cure = inverted(wrong)
        fall = "fall" if len(wrong) > 1 else "falls"
        raise SessionError(f"{name}: the {' and the '.join(sorted(wrong))} {fall} in the press{cure}")
    raise SessionError(f"{name}: the {what} falls in the press, and with its sign inverted it is no press either")


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


def thin_press(press: MeasuredPress) -> MeasuredPress:
    """The press averaged over groups of neighbouring rows, at most `MOST_ROWS` groups.

    If few rows would remain in contact, the begin of the approach is left out first.
    """
    if len(press.depth) <= MOST_ROWS:
        return press
    deepest = deepest_row(press.depth)
    first = int(np.argmax(press.depth > press.touch))
    many = -(-len(press.depth) // MOST_ROWS)
    if deepest - first < many * LEAST_CONTACT:
        begin = max(first - max(AIR_ROWS, 3 * (deepest - first)), 0)
        press = press.part(np.arange(len(press.depth)) >= begin)
    many = -(-len(press.depth) // MOST_ROWS)
    count = len(press.depth) // many

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: count * many].reshape(count, many).mean(axis=1)

    time = None if press.time is None else mean(press.time)
    return replace(press, time=time, depth=mean(press.depth), force=mean(press.force), averaged=many)
