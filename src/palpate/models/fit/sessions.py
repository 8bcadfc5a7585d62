"""Indentation sessions from a CSV file: columns with names and units; errors report row and column.

    subject,session,depth [mm],force [N]
    anna,1,0,0
    anna,1,0.5,0.09

Columns may be in any order, in any form and unit that `physics.table_file` reads. Other columns are ignored and
reported.
"""

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.table_file import Table, read_table
from palpate.physics.table_numbers import number
from palpate.units.header import examples, factor, split_unit

SI = {"depth": "m", "force": "N"}
LIKELY = {"depth": ("m", "mm", "µm"), "force": ("N", "mN")}  # units that a header may have meant
MOST = {"depth": 1.0, "force": 1e4}  # Upper bounds in SI units; a larger value means a wrong unit in the header
NOISE = 0.05  # [1] largest negative force that counts as noise, as a fraction of the subject's largest force
STIFFNESS = (5.0, 1e5)
"""[N/m] Range of largest force over depth for soft tissue under a probe of the size of a fingertip."""
LABELS = ("subject", "session")
NEEDED = (*LABELS, "depth", "force")
SHOWN = 20


class SessionError(PalpateError, ValueError):
    """A file that cannot be used; the message has one line per fault."""

    exit_code = MISUSE

    def to_spec(self) -> dict[str, object]:
        return {"faults": str(self).split("\n")}


@dataclass(frozen=True)
class Subject:
    """The rows of one subject.

    rows     [1]    (n)  line of the file      session  (n)  labels as in the file
    depth    [m]    (n)                        force    [N]  (n)
    units                column -> SI units in the unit of the header
    """

    name: str
    file: str
    rows: np.ndarray
    session: np.ndarray
    depth: np.ndarray
    force: np.ndarray
    units: dict[str, float]

    @property
    def sessions(self) -> list[str]:
        """Labels in the order of the file."""
        return list(dict.fromkeys(self.session.tolist()))

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """(increasing depths (D), forces (S,D)) of sessions that were all measured at the same depths.

        SessionError: depths that are missing, repeated or extra in a session, with session, depth and row.
        """
        steps = np.round(self.depth * 1e9).astype(np.int64)
        depths = np.unique(steps)
        faults, table = [], np.full((len(self.sessions), len(depths)), np.nan)
        counts = {int(d): len(np.unique(self.session[steps == d])) for d in depths}
        common = {d for d, count in counts.items() if 2 * count > len(self.sessions)}
        for s, label in enumerate(self.sessions):
            seen: dict[int, int] = {}
            for i in np.flatnonzero(self.session == label):
                step, row = int(steps[i]), int(self.rows[i])
                if step in seen:
                    faults.append(
                        f"{self.file}, row {row}, column 'depth': session {label!r} of subject {self.name!r} has"
                        f" {step * 1e-6:g} mm twice, first in row {seen[step]}"
                    )
                elif step not in common:
                    faults.append(
                        f"{self.file}, row {row}, column 'depth': found {step * 1e-6:g} mm in session {label!r} of"
                        f" subject {self.name!r}, which most of its sessions do not have; expected the same depths"
                    )
                seen.setdefault(step, row)
                table[s, np.searchsorted(depths, step)] = self.force[i]
            last = int(self.rows[self.session == label][-1])
            for step in sorted(common - set(seen)):
                faults.append(
                    f"{self.file}, after row {last}, column 'depth': session {label!r} of subject {self.name!r} lacks"
                    f" {step * 1e-6:g} mm, which others have; expected the same depths in each session"
                )
        _refuse(faults)
        return depths * 1e-9, table


def read_sessions(path: Path, depth_limit: float = math.inf, dialect: str = "") -> tuple[list[Subject], list[str]]:
    """(subjects in the order of the file, ignored columns); rows deeper than `depth_limit` [m] are excluded.

    dialect  of the numbers, if it cannot be detected: one of `table_numbers.DIALECTS`

    SessionError: a missing file, column or unit, or invalid rows.
    """
    try:
        table = read_table(
            path, lambda cells: len({split_unit(c)[0].lower() for c in cells} & set(NEEDED)), len(NEEDED), dialect
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        if reason == "empty":
            raise SessionError(f"{path}: empty; expected the columns subject, session, depth [mm], force [N]") from None
        raise SessionError(f"{path}: cannot be read: {reason}") from None
    columns, factors, ignored = _header(path, table)
    if not table.rows:
        raise SessionError(f"{path}: no rows after the header in row {table.line}")
    try:
        decimal = table.decimal([columns["depth"], columns["force"]])
    except ValueError as error:
        raise SessionError(f"{path}, {error}") from None
    faults: list[str] = []
    rows = []
    for line, cells in table.rows:
        if len(cells) > len(table.cells):
            faults.append(_too_many(path, line, cells, len(table.cells), table.separator))
            continue
        measurement = _row(path, line, cells, columns, factors, decimal, faults)
        if measurement is not None and measurement["depth"] <= depth_limit * (1.0 + 1e-9):
            rows.append((line, measurement))
    names = list(dict.fromkeys(row["subject"] for _, row in rows))
    largest = {name: max(row["force"] for _, row in rows if row["subject"] == name) for name in names}
    for line, row in rows:
        if row["force"] < -NOISE * max(largest[row["subject"]], 0.0):
            faults.append(
                f"{path}, row {line}, column 'force': found {row['force'] / factors['force']:g}, expected a force"
                f" that is not negative, except for noise of at most {100 * NOISE:g} % of the subject's largest one"
            )
    _refuse(faults)
    if not rows:
        raise SessionError(f"{path}: no row is left up to the depth limit of {depth_limit * 1e3:g} mm")
    subjects = []
    for name in names:
        lines, part = zip(*((n, row) for n, row in rows if row["subject"] == name), strict=True)
        session, depth, force = (np.array([row[key] for row in part]) for key in ("session", "depth", "force"))
        subjects.append(Subject(name, str(path), np.array(lines), session, depth, force, factors))
    return subjects, ignored


def _too_many(path: Path, line: int, cells: list[str], count: int, separator: str) -> str:
    """Message for a row with more cells than the header."""
    where = f"{path}, row {line}: {len(cells)} cells, the header has {count}"
    if separator == "," and any(re.fullmatch(r"\s*[+-]?\d+\s*", a) and re.fullmatch(r"\d+([eE][+-]?\d+)?\s*", b)
                                for a, b in pairwise(cells)):  # fmt: skip
        return f"{where}; decimal commas? Write numbers with a point, such as 0.5"
    return f"{where}; expected as many"


def check_stiffness(subjects: list[Subject]) -> None:
    """SessionError: the largest force over depth is impossible for soft tissue, so that a unit must be wrong."""
    faults = []
    low, high = STIFFNESS
    for subject in subjects:
        pressed = subject.depth > 0
        if not pressed.any() or not (force := subject.force[pressed].max()) > 0:
            continue
        depth = subject.depth[pressed][subject.force[pressed].argmax()]
        if low <= force / depth <= high:
            continue
        cures = {
            size: f"'{name} [{unit}]'"
            for name, power in (("force", 1), ("depth", -1))
            for unit, size in ((unit, factor(unit, SI[name])) for unit in LIKELY[name])
            if low <= force / depth * (size / subject.units[name]) ** power <= high
        }
        faults.append(
            f"{subject.file}, from row {subject.rows[0]}, column 'force': subject {subject.name!r} has {force:.3g} N at"
            f" {depth * 1e3:.3g} mm, {force / depth:.3g} N/m; soft tissue under a fingertip has {low:g} ... {high:g}"
            f" N/m. Is a unit in the header wrong? {' or '.join(cures.values()) or 'None'} would fit. If the"
            " numbers are right, --any-stiffness accepts them"
        )
    _refuse(faults)


def _header(path: Path, table: Table) -> tuple[dict[str, int], dict[str, float], list[str]]:
    columns: dict[str, int] = {}
    factors: dict[str, float] = {}
    faults, ignored = [], []
    cells = table.cells
    for place, (cell, name) in enumerate(zip(cells, table.names, strict=True)):
        name = name.lower()
        if name in columns:
            faults.append(f"{path}, header: column {name!r} twice")
        elif name in LABELS:
            columns[name] = place
        elif name in SI:
            columns[name] = place
            try:
                size = table.factor(place, SI[name])
            except ValueError as error:
                faults.append(f"{path}, {error}")
                continue
            if size is None:
                faults.append(
                    f"{path}, header, column {name!r}: no unit; write '{name} [UNIT]', with {examples(SI[name])} or"
                    " another as UNIT"
                )
            else:
                factors[name] = size
        else:
            ignored.append(cell.strip())
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        faults.append(
            f"{path}, header: no column {', '.join(map(repr, missing))}; found {', '.join(map(repr, cells))};"
            " expected subject, session, depth [mm], force [N]"
        )
    _refuse(faults)
    return columns, factors, ignored


def _row(
    path: Path, line: int, cells: list[str], columns: dict[str, int], factors: dict[str, float], decimal: str,
    faults: list[str],
) -> dict | None:  # fmt: skip
    """The values of one row in SI units; None, with entries in `faults`, for an invalid row."""
    before = len(faults)
    measurement: dict = {}
    for name, place in columns.items():
        where = f"{path}, row {line}, column {name!r}"
        text = cells[place].strip() if place < len(cells) else ""
        if not text:
            faults.append(f"{where}: empty, expected {'a label' if name in LABELS else 'a number'}")
        elif name in LABELS:
            measurement[name] = text
        else:
            value = number(text, decimal)
            if value is None:
                faults.append(f"{where}: found {text!r}, expected a number with a decimal point")
                continue
            if not math.isfinite(value):
                faults.append(f"{where}: found {text!r}, expected a finite number")
            elif name == "depth" and value < 0:
                faults.append(f"{where}: found {text}, expected a {name} that is not negative")
            elif abs(value * factors[name]) > MOST[name]:
                faults.append(f"{where}: found {text}, which cannot be a {name}; is the unit in the header right?")
            else:
                measurement[name] = value * factors[name]
    return measurement if len(faults) == before else None


def _refuse(faults: list[str]) -> None:
    if faults:
        rest = [f"... and {len(faults) - SHOWN} more"] if len(faults) > SHOWN else []
        raise SessionError("\n".join(faults[:SHOWN] + rest))
