"""Columns of a table of presses: their names, units and numbers in SI units."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.physics.table_file import COARSE, Table, coarse_step, read_table
from palpate.units.header import examples, factor, same_unit, split_unit
from palpate.units.symbols import UnitError

NAMES = {
    "time": ("time", "t", "x_value"), "force": ("force", "load", "f", "fz", "fn", "normal force"),
    "indentation": ("indentation", "depth", "compression", "approach", "d", "penetration depth", "pd"),
}  # fmt: skip
"""Quantity -> default names of its column."""
OTHERS = {"time": ("timestamp", "time stamp", "elapsed time")}
"""Names that count if no column has a default name: a table may have both `Time` and `Timestamp`."""
ROSBAG = "field."  # before the names of a message that `rostopic echo -p` prints
SI = {"time": "s", "force": "N", "indentation": "m"}
LARGEST = {"time": 1e6, "force": 1e4, "indentation": 0.5}  # Upper bounds in SI units; a larger value means a wrong unit
WITHOUT_TIME = "--columns time= leaves the time out"


def table_of(path: Path, columns: Mapping[str, str], dialect: str) -> Table:
    """The table of a file whose header names force and indentation. SessionError: it cannot be read."""

    def score(cells: Sequence[str]) -> int:
        return sum(bool(_places(cells, key, columns)) for key in needed)

    needed = {"force", "indentation", *(key for key, column in columns.items() if column)}
    try:
        return read_table(path, score, len(needed), dialect)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SessionError(f"{path}: cannot be read: {reason}") from None


def numbers_of(
    path: Path, table: Table, found: Mapping[str, tuple[int, float]], columns: Mapping[str, str],
    units: Mapping[str, str],
) -> tuple[np.ndarray, list[int], list[str]]:  # fmt: skip
    """SI values (n, k) of the found columns, the line of each row, and a text per column. SessionError: a fault."""
    time = found["time"][0] if "time" in found else None
    try:
        values, lines = table.values([k for k, _ in found.values()], time)
    except ValueError as error:
        cure = f"; {WITHOUT_TIME}" if time is not None and f"column {table.cells[time].strip()!r}" in str(error) else ""
        raise SessionError(f"{path}, {error}{cure}") from None
    if not len(values):
        raise SessionError(f"{path}: no rows after the header in row {table.line}")
    factors = [factor_of(path, key, table, k, columns, units) for key, (k, _) in found.items()]
    shown = []
    for (key, (k, sign)), size, column in zip(found.items(), factors, values.T, strict=True):
        far = np.abs(column - (column[0] if key == "time" else 0.0)) * size  # clocks count from anywhere
        large = np.flatnonzero(far > LARGEST[key])
        if len(large):
            where = f"{path}, row {lines[large[0]]}, column {table.cells[k].strip()!r}"
            what = "spans more than a press lasts" if key == "time" else f"too large for the {key} of a press"
            raise SessionError(f"{where}: found {column[large[0]]:g}, {what}; is the unit right?")
        column *= sign * size
        inverted = ", inverted" if sign < 0.0 else ""
        replaced = _replaced(key, table, k, columns, units)
        shown.append(f"{key} from {table.cells[k].strip()!r} times {size:.6g} {SI[key]}{inverted}{replaced}")
    return values, lines, shown


def _places(cells: Sequence[str], key: str, columns: Mapping[str, str]) -> list[int]:
    """The columns of a quantity: those with the name or number that the user gave, else with a default name."""
    wanted = columns.get(key, "").removeprefix("-").strip()
    names = [split_unit(cell)[0] for cell in cells]
    if not wanted:
        plain = [name.lower() for name in names]
        bare = [name.removeprefix(ROSBAG) for name in plain]
        tiers = ((plain, NAMES[key]), (plain, OTHERS.get(key, ())), (bare, NAMES[key]))
        found = ([k for k, name in enumerate(each) if name in known] for each, known in tiers)
        return next(filter(None, found), [])
    marked = wanted.lstrip("%#/ ")  # of a header in a comment
    places = [k for k, (name, cell) in enumerate(zip(names, cells, strict=True))
              if {wanted, marked} & {name, cell.strip()}]  # fmt: skip
    if not places and wanted.isdigit() and 0 < int(wanted) <= len(cells):
        return [int(wanted) - 1]
    return places


def columns_of(path: Path, table: Table, columns: Mapping[str, str]) -> dict[str, tuple[int, float]]:
    """Quantity -> (column, sign). SessionError: a column is missing, or several match."""
    found, missing = {}, []
    for key in NAMES:
        if columns.get(key, "default") == "":  # left out
            continue
        places = _places(table.cells, key, columns)
        if len(places) > 1 and key not in columns:  # Load (uN) and Load (V): only one is a force
            places = table.units.choose(places, SI[key])
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


def specimen_column(path: Path, table: Table, columns: Mapping[str, str]) -> int | None:
    """The column that the user says names the specimens; None: no such option. SessionError: none or several columns
    have this name."""
    wanted = columns.get("specimen", "")
    places = _places(table.cells, "specimen", columns) if wanted else []
    if wanted and len(places) != 1:
        found = ", ".join(repr(cell.strip()) for cell in table.cells)
        raise SessionError(
            f"{path}, row {table.line}: {len(places)} columns {wanted!r}; expected one of {found}, or its number, as "
            "the name of the specimens"
        )
    return places[0] if wanted else None


def inverting(found: Mapping[str, tuple[int, float]], names: Collection[str]) -> str:
    """The option that inverts the sign of some of the found columns, complete, by number."""
    signs = {key: (k + 1, -sign if key in names else sign) for key, (k, sign) in found.items()}
    listed = ",".join(f"{key}={'-' if sign < 0.0 else ''}{k}" for key, (k, sign) in signs.items())
    return f"; --columns {listed} inverts it"


def check_time(path: Path, table: Table, place: int, times: np.ndarray, columns: Mapping[str, str],
               units: Mapping[str, str]) -> None:  # fmt: skip
    """SessionError: a column of time without a unit, with rows so far apart that they are hardly in seconds."""
    if not (given_unit("time", table, place, columns, units) or table.unit(place)) and (step := coarse_step(times)):
        raise SessionError(
            f"{path}, row {table.line}, column {table.cells[place].strip()!r}: no unit; in s its rows would be "
            f"{step:.3g} s apart, expected less than {COARSE:g} s. Give it with --unit time=UNIT, with {examples('s')} "
            f"as UNIT; {WITHOUT_TIME}"
        )


def given_unit(key: str, table: Table, place: int, columns: Mapping[str, str], units: Mapping[str, str]) -> str:
    """The unit of a column by the option --unit; "" if it is not given."""
    names = (key, columns.get(key, "").removeprefix("-").strip(), table.cells[place].strip(), table.names[place])
    return next((units[name] for name in names if name in units), "")


def factor_of(
    path: Path, key: str, table: Table, place: int, columns: Mapping[str, str], units: Mapping[str, str]
) -> float:
    """Factor from the unit of a column to the SI unit. SessionError: none, unknown, contradictory, another dimension.

    A remedy names no unit that the file does not show, because a person may follow it literally.
    """
    cell, named = table.cells[place].strip(), columns.get(key, "").removeprefix("-").strip() or key
    where, si = f"{path}, row {table.line}, column {cell!r}", SI.get(key, "m")
    given = given_unit(key, table, place, columns, units)
    try:
        unit = given or table.unit(place)
    except ValueError as error:
        raise SessionError(f"{path}, {error}, or give the right one with --unit {named}=UNIT") from None
    if not unit:
        if key == "time":
            return 1.0
        raise SessionError(f"{where}: no unit; give it with --unit {named}=UNIT, with {examples(si)} or another as "
                           "UNIT")  # fmt: skip
    try:
        return factor(unit, si)
    except UnitError as error:
        cure = f". Give it with --unit {named}=UNIT" if "unknown" in str(error) else ""
        weight = unit.lower() if unit in ("g", "kg", "Kg", "KG") else ""
        cure = f". If it shows a weight: --unit {named}={weight}f" if weight and key == "force" else cure
        raise SessionError(f"{where}: {error}{cure}") from None


def _replaced(key: str, table: Table, place: int, columns: Mapping[str, str], units: Mapping[str, str]) -> str:
    """A remark that the option --unit replaces the unit of the file."""
    given = given_unit(key, table, place, columns, units)
    try:
        unit = table.unit(place)
    except ValueError:
        unit = "two units"
    return f" (--unit {given} replaces the {unit} of the file)" if given and unit and not same_unit(given, unit) else ""
