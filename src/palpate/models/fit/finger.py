"""The elastic law of fingertips from presses whose touch point is unknown.

    f = (b_i/m) (e^(m (s - s_j)) - 1) for s > s_j, else 0

for the travel s of press j of person i: one m, one b per person, one touch point s_j per press, by least squares of the
loading parts, in which each press has the same weight. The slope of the law, df/ds = b + m f, does not depend on the
touch point, so force and travel determine b and m. The law is that of D. T. V. Pawluk and R. D. Howe, J. Biomech. Eng.
121 (1999) 178. Intervals are from the presses: each press is left out in turn (jackknife, Student's t), because the
rows of a press share its errors; with fewer than three presses they are withheld.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # loads its subpackages on first use

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import check_one_body, row_labels
from palpate.physics.table_file import read_table
from palpate.units.header import examples, split_unit

SI = {"travel": "m", "force": "N"}
LARGEST = {"travel": 0.02, "force": 50.0}  # [m] [N] of a finger; more is a wrong unit
LEAST = 20  # rows of a press until its peak
TOUCH = 0.03  # [1] share of the peak force from which a press is searched for its touch point
EARLY = 0.25  # [1] touch point before the first row, over the travel, from which b is not determined
MOST = 200  # rows of a press that are fitted


class FingerPress(NamedTuple):
    """Loading part of a press: travel [m] (n), force [N] (n) relative to that of the first rows."""

    travel: np.ndarray
    force: np.ndarray


class FingerFit(NamedTuple):
    """b [N/m] per person, m [1/m], touch point [m] per press, rms of the residual [N], 95 % intervals of b and of m."""

    stiffness: np.ndarray
    hardening: float
    touch: np.ndarray
    residual: float
    intervals: tuple[tuple[float, float], ...] | None


def read_presses(path: Path, notes: list[str] | None = None, dialect: str = "") -> list[FingerPress]:
    """The presses of a table with columns travel and force, with units, and a column press if there are several.

    notes    takes which lines were not read
    dialect  of the numbers, if it cannot be detected: one of `table_numbers.DIALECTS`

    SessionError: cannot be used; says where and why.
    """
    try:
        found = read_table(path, lambda cells: len(set(SI) & {split_unit(c)[0].lower() for c in cells}), 2, dialect)
        names = [name.lower() for name in found.names]
        if missing := [name for name in SI if name not in names]:
            raise ValueError(f"found the columns {', '.join(names)}; expected {', '.join(missing)} too")
        if twice := [name for name in (*SI, "press") if names.count(name) > 1]:
            raise ValueError(f"row {found.line}: two columns {twice[0]!r}; expected one")
        columns = [names.index(name) for name in SI]
        factors = [found.factor(column, SI[name]) for name, column in zip(SI, columns, strict=True)]
        for name, factor in zip(SI, factors, strict=True):
            if factor is None:
                raise ValueError(f"row {found.line}, column {name!r}: found no unit, expected one in the header: "
                                 f"`{name} [UNIT]`, with {examples(SI[name])} or another as UNIT")  # fmt: skip
        check_one_body(path, found, "the presses of one finger")
        rows, lines = found.values(columns)
        if not len(rows):
            raise ValueError(f"no rows after the header in row {found.line}")
        for k, (name, factor) in enumerate(zip(SI, factors, strict=True)):
            rows[:, k] *= factor or 1.0
            worst = int(np.argmax(np.abs(rows[:, k] - rows[0, k])))
            if abs(rows[worst, k] - rows[0, k]) > LARGEST[name]:
                raise ValueError(f"row {lines[worst]}, column {name!r}: found a change of "
                                 f"{rows[worst, k] - rows[0, k]:.3g}, expected at most {LARGEST[name]:g} in SI units: "
                                 "is its unit right?")  # fmt: skip
        labels = np.array(row_labels(found, lines, rows[:, 0], joined=True)[0])
        if notes is not None:
            notes += found.skipped
        return [_loading(rows[labels == label], f"press {label}") for label in dict.fromkeys(labels.tolist())]
    except SessionError:
        raise
    except OSError as error:
        raise SessionError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise SessionError(f"{path}: {error}") from None


def _loading(rows: np.ndarray, name: str) -> FingerPress:
    """The part of a press until its largest force, thinned to `MOST` rows. ValueError: no press."""
    top = int(np.argmax(rows[:, 1]))
    travel, force = rows[: top + 1, 0], rows[: top + 1, 1]
    if top + 1 < LEAST or travel[-1] <= travel[0]:
        raise ValueError(f"{name}: found {top + 1} rows until its largest force, expected {LEAST} and more with rising "
                         "travel")  # fmt: skip
    force = force - np.median(force[: max(LEAST // 4, len(force) // 50)])
    if not force[-1] > 0.0:
        raise ValueError(f"{name}: the force does not rise")
    keep = np.unique(np.linspace(0, top, min(MOST, top + 1)).astype(int))
    return FingerPress(travel[keep], force[keep])


def fit_fingers(people: Sequence[Sequence[FingerPress]]) -> FingerFit:
    """One law for all presses of all people."""
    whole = _solve(people)
    presses = [(i, j) for i, each in enumerate(people) for j in range(len(each))]
    if min(map(len, people)) < 3:
        return whole
    parts = []
    for i, j in presses:
        fewer = [[p for k, p in enumerate(each) if (n, k) != (i, j)] for n, each in enumerate(people)]
        part = _solve(fewer, whole)
        parts.append(np.log([*part.stiffness, part.hardening]))
    middle, n = np.log([*whole.stiffness, whole.hardening]), len(parts)
    spread = np.sqrt((n - 1) / n * np.sum((np.array(parts) - np.mean(parts, axis=0)) ** 2, axis=0))
    half = scipy.stats.t.ppf(0.975, n - 1) * spread
    ends = zip(np.exp(middle - half), np.exp(middle + half), strict=True)
    return whole._replace(intervals=tuple((float(low), float(high)) for low, high in ends))


def undetermined(presses: Sequence[FingerPress], fit: FingerFit) -> str:
    """Why the presses of a person do not determine b; "" if they do.

    Where b is small over m f, the law is an exponential of the travel whose beginning is not seen: b tends to 0 while
    the touch point moves away, although the force of the first rows counts as 0.
    """
    early = [(p.travel[0] - s) / (p.travel[-1] - p.travel[0]) for p, s in zip(presses, fit.touch, strict=True)]
    if max(early) <= EARLY:
        return ""
    away = 1e3 * max(p.travel[0] - s for p, s in zip(presses, fit.touch, strict=True))
    return (
        f"the touch point fits best {away:.2g} mm before the first row, where the force counts as 0: the presses do "
        "not determine finger_stiffness. Record more presses that begin above the finger, with less noise below 0.05 N"
    )


def _solve(people: Sequence[Sequence[FingerPress]], near: FingerFit | None = None) -> FingerFit:
    presses = [(i, press) for i, each in enumerate(people) for press in each]
    count = len(people)

    def residuals(x: np.ndarray) -> np.ndarray:
        m, out = np.exp(x[0]), []
        for k, (i, press) in enumerate(presses):
            depth = np.clip(press.travel - 1e-3 * x[1 + count + k], 0.0, 30.0 / m)
            out.append((np.exp(x[1 + i]) / m * np.expm1(m * depth) - press.force) / np.sqrt(len(depth)))
        return np.concatenate(out)

    begins = [1e3 * p.travel[int(np.argmax(p.force > TOUCH * p.force[-1]))] for _, p in presses]
    first = (
        [np.log(near.hardening), *np.log(near.stiffness)] if near else [np.log(1200.0), *np.full(count, np.log(40.0))]
    )
    found = scipy.optimize.least_squares(
        residuals, [*first, *begins], x_scale=[0.2] * (1 + count) + [0.1] * len(presses)
    )
    rms = float(np.sqrt(np.sum(found.fun**2) / len(presses)))
    x = found.x
    return FingerFit(np.exp(x[1 : 1 + count]), float(np.exp(x[0])), 1e-3 * x[1 + count :], rms, None)
