"""Columns of a table of presses: their names, units and numbers in SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.physics.table_cells import split_unit
from palpate.physics.table_file import COARSE, Table, coarse_step, read_table

NAMES = {
    "time": ("time", "t"), "force": ("force", "load", "f", "fz", "fn", "normal force"),
    "indentation": ("indentation", "depth", "compression", "approach", "d", "penetration depth", "pd"),
}  # fmt: skip
"""Quantity -> default names of its column."""
SI = {"time": "s", "force": "N", "indentation": "m"}
LARGEST = {"time": 1e6, "force": 1e4, "indentation": 0.5}  # Upper bounds in SI units; a larger value means a wrong unit

Convert = Callable[[str, str], float]
"""(quantity such as '1 mm', SI unit) -> number."""


def table_of(path: Path, columns: Mapping[str, str], dialect: str) -> Table:
    """The table of a file whose header names force and indentation. SessionError: it cannot be read."""

    def score(cells: Sequence[str]) -> int:
        return sum(bool(_places(cells, key, columns)) for key in {"force", "indentation", *columns})

    try:
        return read_table(path, score, len({"force", "indentation", *columns}), dialect)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SessionError(f"{path}: cannot be read: {reason}") from None


def numbers_of(
    path: Path, table: Table, found: Mapping[str, tuple[int, float]], columns: Mapping[str, str],
    units: Mapping[str, str], convert: Convert,
) -> tuple[np.ndarray, list[int], list[str]]:  # fmt: skip
    """SI values (n, k) of the found columns, the line of each row, and a text per column. SessionError: a fault."""
    factors = [factor_of(path, key, table, k, columns, units, convert) for key, (k, _) in found.items()]
    try:
        values, lines = table.values([k for k, _ in found.values()])
    except ValueError as error:
        raise SessionError(f"{path}, {error}") from None
    if not len(values):
        raise SessionError(f"{path}: no rows after the header in row {table.line}")
    shown = []
    for (key, (k, sign)), factor, column in zip(found.items(), factors, values.T, strict=True):
        large = np.flatnonzero(np.abs(column * factor) > LARGEST[key])
        if len(large):
            where = f"{path}, row {lines[large[0]]}, column {table.cells[k].strip()!r}"
            raise SessionError(
                f"{where}: found {column[large[0]]:g}, too large for the {key} of a press; is the unit right?"
            )
        column *= sign * factor
        inverted = ", inverted" if sign < 0.0 else ""
        shown.append(f"{key} from {table.cells[k].strip()!r} times {factor:.6g} {SI[key]}{inverted}")
    return values, lines, shown


def _places(cells: Sequence[str], key: str, columns: Mapping[str, str]) -> list[int]:
    """The columns of a quantity: those with the name or number that the user gave, else with a default name."""
    wanted = columns.get(key, "").removeprefix("-").strip()
    names = [split_unit(cell)[0] for cell in cells]
    if not wanted:
        return [k for k, name in enumerate(names) if name.lower() in NAMES[key]]
    places = [k for k, (name, cell) in enumerate(zip(names, cells, strict=True)) if wanted in (name, cell.strip())]
    if not places and wanted.isdigit() and 0 < int(wanted) <= len(cells):
        return [int(wanted) - 1]
    return places


def _may_be(unit: str, si: str, convert: Convert) -> bool:
    """Whether a column with this unit, or without one, may have the dimension of an SI unit."""
    try:
        convert(f"1 {unit}", si)
    except ValueError as error:
        return not unit or "expected" not in str(error)
    return True


def columns_of(path: Path, table: Table, columns: Mapping[str, str], convert: Convert) -> dict[str, tuple[int, float]]:
    """Quantity -> (column, sign). SessionError: a column is missing, or several match."""
    found, missing = {}, []
    for key in NAMES:
        places = _places(table.cells, key, columns)
        if len(places) > 1 and key not in columns:  # Load (uN) and Load (V): only one is a force
            fitting = [k for k in places if _may_be(table.units[k], SI[key], convert)]
            places = fitting if len(fitting) == 1 else places
        if len(places) > 1:
            cells = [f"{table.cells[k].strip()!r} (column {k + 1})" for k in places]
            distinct = len({table.names[k] for k in places}) == len(places)
            choices = [f"{key}={table.names[places[0]]}"] * distinct + [f"{key}={places[0] + 1}"]
            raise SessionError(
                f"{path}, row {table.line}: {' and '.join(cells)} both name the {key}; choose one by name or number: "
                f"--columns {' or '.join(choices)}"
            )
        if places:
            found[key] = (places[0], -1.0 if columns.get(key, "").startswith("-") else 1.0)
        elif key != "time" or key in columns:
            missing.append(key)
    if missing:
        shown = table.separator.join(table.cells).strip()[:120]
        raise SessionError(
            f"{path}: no header with a column for {' and '.join(missing)}; found {shown!r} in row {table.line}. Name "
            "them: --columns time=t,force=F,indentation=d"
        )
    return found


def check_time(path: Path, table: Table, place: int, times: np.ndarray, columns: Mapping[str, str],
               units: Mapping[str, str]) -> None:  # fmt: skip
    """SessionError: a column of time without a unit, with rows so far apart that they are hardly in seconds."""
    if not unit_of("time", table, place, columns, units) and (step := coarse_step(times)):
        raise SessionError(
            f"{path}, row {table.line}, column {table.cells[place].strip()!r}: no unit; in s its rows would be "
            f"{step:.3g} s apart, expected less than {COARSE:g} s. Give it with --unit time=ms or time=s"
        )


def unit_of(key: str, table: Table, place: int, columns: Mapping[str, str], units: Mapping[str, str]) -> str:
    """The unit of a column, of the option --unit or of the header; "" if it has none."""
    names = (key, columns.get(key, "").removeprefix("-").strip(), table.cells[place].strip(), table.names[place])
    return next((units[name] for name in names if name in units), table.units[place])


def factor_of(
    path: Path, key: str, table: Table, place: int, columns: Mapping[str, str], units: Mapping[str, str],
    convert: Convert,
) -> float:  # fmt: skip
    """Factor from the unit of a column to the SI unit."""
    cell, named = table.cells[place].strip(), columns.get(key, "").removeprefix("-").strip()
    unit = unit_of(key, table, place, columns, units)
    where = f"{path}, row {table.line}, column {cell!r}"
    if not unit:
        if key != "time":
            example = "N" if key == "force" else "mm"
            raise SessionError(f"{where}: no unit; give it with --unit {named or key}={example}")
        return 1.0
    try:
        return convert(f"1 {unit}", SI.get(key, "m"))
    except ValueError as error:
        cure = "" if "expected" in str(error) else f". Give it with --unit {named or key}={SI.get(key, 'm')}"
        cure = f". If it shows a weight: --unit {named or key}={unit}f" if unit in ("g", "kg") else cure
        raise SessionError(f"{where}, unit {unit!r}: {error}{cure}") from None
