"""Probes of an organ from a table: many presses with few rows each, with their places and normals if it has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.models.fit.probes.pooled import LEAST_PROBES, Rows
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import BODIES, columns_named
from palpate.models.fit.tissue.table import (
    columns_of,
    factor_of,
    inverting,
    numbers_of,
    specimen_column,
    table_of,
)
from palpate.physics.table_file import Table

PROBE = "probe"
LABELS = ("subject", "session", "press")
"""Columns that name a probe."""
SPARSE = 40  # Most rows of a probe; longer presses are fitted one by one
LEAST_ROWS = 4  # of a probe
PLACE, NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
CLEAR = 5.0  # [1] Least largest force of a probe, over the noise of the file
WIDEST = 1.0  # [m] of the probed region


@dataclass(frozen=True)
class Probes:
    """Probes of one file.

    names    (N) labels
    places, normals   (N,3) [m], [1] of first contact; None: the file has none
    dropped  which probes and rows are left out, and why
    read     which columns were read
    """

    names: list[str]
    rows: Rows
    places: np.ndarray | None
    normals: np.ndarray | None
    dropped: list[str]
    read: list[str]

    def part(self, keep: np.ndarray) -> Probes:
        """The probes of a mask (N) only."""
        rows = Rows(*(a[keep] for a in (self.rows.depth, self.rows.force, self.rows.mask)))
        places, normals = (None if a is None else a[keep] for a in (self.places, self.normals))
        names = [name for name, here in zip(self.names, keep, strict=True) if here]
        return Probes(names, rows, places, normals, self.dropped, self.read)


def read_probes(path: Path, columns: Mapping[str, str], units: Mapping[str, str], dialect: str = "") -> Probes | None:
    """The probes of a file; None: it has few presses, or many rows per press. SessionError: a fault, with its row."""
    table = table_of(path, columns, dialect)
    names = [name.lower() for name in table.names]
    labels = [names.index(name) for name in (PROBE, *LABELS) if name in names]
    cells = [row for _, row in table.rows]
    keys = [" ".join(row[k].strip() for k in labels if k < len(row)) for row in cells]
    groups: dict[str, list[int]] = {}
    for i, key in enumerate(keys):
        if key:
            groups.setdefault(key, []).append(i)
    if len(groups) < LEAST_PROBES or np.median([len(group) for group in groups.values()]) > SPARSE:
        return None
    found = columns_of(path, table, {key: value for key, value in columns.items() if key != "time"})
    found.pop("time", None)
    given = specimen_column(path, table, columns)
    bodies = columns_named(table, [b for b in BODIES if b not in LABELS]) if given is None else [given]
    for k in bodies if columns.get("specimen") != "" else ():
        if len({row[k].strip() for row in cells if k < len(row)}) > 1:
            raise SessionError(f"{path}: column {table.cells[k].strip()!r} names more than one specimen, expected the "
                               "probes of one organ; save the rows of each in its file")  # fmt: skip
    values, lines, shown = numbers_of(path, table, found, columns, units)
    depth, force = (values[:, list(found).index(key)] for key in ("indentation", "force"))
    places = _vectors(path, table, PLACE, len(values), units)
    normals = _vectors(path, table, NORMAL, len(values), None)
    kept, dropped = _deepening(path, groups, depth, lines)
    if not kept:
        raise SessionError(f"{path}: 0 of {len(groups)} probes remain: {dropped[0]}{inverting(found, ['indentation'])}")
    rises = [force[order].max() - force[order][0] for order in kept.values()]
    noise = _noise([force[order] for order in kept.values()])
    rising = list(kept.values())
    for name, rise in zip(list(kept), rises, strict=True):
        if not rise > CLEAR * noise:
            dropped.append(f"{path.name}, probe {name}: the force rises by {rise:.2g} N, expected more than {CLEAR:g} "
                           f"times the noise of {noise:.2g} N")  # fmt: skip
            kept.pop(name)
    if len(kept) < LEAST_PROBES:
        falls = sum(force[order][0] - force[order].min() > CLEAR * noise for order in rising)
        cure = inverting(found, ["force"]) if falls >= LEAST_PROBES else ""
        raise SessionError(
            f"{path}: {len(kept)} of {len(groups)} probes remain, expected at least {LEAST_PROBES}: {dropped[0]}{cure}"
        )
    rows_of = Rows.of([depth[order] for order in kept.values()], [force[order] for order in kept.values()])
    first = [order[0] for order in kept.values()]
    at = None if places is None else places[first]
    if at is not None and float(np.ptp(at, axis=0).max()) > WIDEST:
        raise SessionError(f"{path}: the places span {np.ptp(at, axis=0).max():.3g} m, expected at most {WIDEST:g} m; "
                           "are the units of x, y, z right?")  # fmt: skip
    towards = None if normals is None else _units(path, normals[first], [lines[k] for k in first])
    return Probes(list(kept), rows_of, at, towards, dropped, [f"{path.name}: {', '.join(shown)}"])


def _deepening(
    path: Path, groups: Mapping[str, list[int]], depth: np.ndarray, lines: Sequence[int]
) -> tuple[dict[str, list[int]], list[str]]:
    """The rows of each probe with increasing depth [m] (n), without probes of few rows, and a note on each row and
    probe that is left out. lines (n): rows of the file."""
    kept: dict[str, list[int]] = {}
    dropped = []
    for name, group in groups.items():
        rows = [i for i in group if i < len(depth)]
        order = [rows[0]] if rows else []
        for i in rows[1:]:
            if depth[i] > depth[order[-1]]:
                order.append(i)
        if len(order) < len(rows):
            back = [str(lines[i]) for i in rows if i not in order]
            dropped.append(f"{path.name}, probe {name}: row {', '.join(back[:5])}: the depth does not increase")
        if len(order) < LEAST_ROWS:
            dropped.append(f"{path.name}, probe {name}: {len(order)} rows, expected at least {LEAST_ROWS}")
            continue
        kept[name] = order
    return kept, dropped


def _units(path: Path, normals: np.ndarray, lines: Sequence[int]) -> np.ndarray:
    """The normals (n,3) with the length 1. SessionError: one differs from 1 by 10 %. lines (n): rows of the file."""
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    if not (np.abs(size - 1.0) < 0.1).all():
        worst = int(np.argmax(np.abs(size - 1.0)))
        raise SessionError(
            f"{path}, row {lines[worst]}: the normal has the length {float(size[worst, 0]):.3g}, expected 1"
        )
    return normals / size


def _noise(forces: list[np.ndarray]) -> float:
    """Standard deviation [N] from third differences, which are 0 on a parabola."""
    differences = np.concatenate([np.diff(f, 3) for f in forces])
    return float(np.median(np.abs(differences))) / 0.6745 / np.sqrt(20.0)


def _vectors(
    path: Path, table: Table, names: tuple[str, ...], count: int, units: Mapping[str, str] | None
) -> np.ndarray | None:
    """The vectors (n,3) of three columns; None: the table has none of them. SessionError: one is missing."""
    heads = [name.lower() for name in table.names]
    there = [name for name in names if name in heads]
    if not there:
        return None
    if len(there) < 3:
        raise SessionError(f"{path}, row {table.line}: found the column {there[0]!r}, expected {', '.join(names)}")
    places = [heads.index(name) for name in names]
    factors = [1.0] * 3
    if units is not None:
        factors = [factor_of(path, n, table, k, {}, units) for n, k in zip(names, places, strict=True)]
    try:
        values, _ = table.values(places)
    except ValueError as error:
        raise SessionError(f"{path}, {error}") from None
    return values[:count] * np.array(factors)
