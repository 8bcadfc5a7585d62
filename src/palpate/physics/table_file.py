"""Tables of numbers as instruments, spreadsheets and robots write them: encoding, separator, header, decimal sign.

The header is the first line in which the caller recognises all columns that it needs; lines before it are skipped, and
so is a footer. Recognised: the encodings and workbooks of `table_text`; separators tab, semicolon, comma, bar and
blanks; units in the forms of `units.header`, in a row below the header or in a comment (`table_units`); a header in a
comment (`numpy.savetxt`, JPK, `%` of MATLAB, rosbag); blocks that repeat the header. `table_numbers` reads the numbers,
`table_times` the times. Every fault names its line.
"""

import math
import re
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.physics.table_cells import (
    BLANK,
    SEPARATORS,
    are_units,
    cells_of,
    is_row,
    join_units,
    row_count,
    split_cells,
    split_row,
    texts_of,
)
from palpate.physics.table_numbers import check_dialect, decimal_sign, number, with_point
from palpate.physics.table_text import text_lines
from palpate.physics.table_times import DAY, LARGE, are_days, clock_seconds, from_first, is_clock, stamp_unit
from palpate.physics.table_units import Units
from palpate.units.header import factor
from palpate.units.symbols import UnitError

REMARK = re.compile(r"\s*(?:#(?!(?:N/A|DIV/0!|VALUE!|REF!|NAME\?|NUM!|NULL!))|%|//)")  # but no error of Excel
COMMENT = re.compile(r"\s*(?:#+|%+|/{2,}) *(?:columns\s*:)?\s*?")
NUMBER = re.compile(r'\s*"?[+-]?[.,]?\d')  # the begin of a row of numbers
MOST_FOOTER = 5  # Rows of text in all needed columns; more of them are a sensor that failed
COARSE, FEW = 0.5, 20
"""[s] Median time between the rows of a longer table than `FEW` rows, from which on its unit must be given."""
MOST_BELOW = 3  # lines between the header and its units


@dataclass
class Table:
    """Rows of a file: (line, cells), and its header with the names and units of the columns.

    cells    header cells as in the file
    line     line of the header
    blocks   lines at which the header is repeated
    skipped  notes on lines that were not read
    clocks   units of the columns that contain times of day or stamps, found by `values`
    """

    line: int
    cells: list[str]
    units: Units
    rows: list[tuple[int, list[str]]]
    separator: str
    dialect: str | None = ""
    blocks: tuple[int, ...] = ()
    skipped: list[str] = field(default_factory=list)
    clocks: dict[int, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the columns, without units."""
        return self.units.names

    def unit(self, k: int) -> str:
        """The unit of column k, "" if it has none. ValueError: two places contradict each other."""
        return self.clocks.get(k) or self.units.of(k)

    def factor(self, k: int, si: str, given: str = "") -> float | None:
        """Factor from the unit of column k, or from the given one, to an SI unit; None: it has no unit.

        ValueError: contradictory or unknown units, or another dimension, with the column.
        """
        unit = self.clocks.get(k) or given or self.units.of(k)
        try:
            return factor(unit, si) if unit else None
        except UnitError as error:
            raise ValueError(f"row {self.line}, column {self.cells[k].strip()!r}: {error}") from None

    def decimal(self, columns: Sequence[int]) -> str:
        """Decimal sign of these columns. ValueError: comma and point are equally likely."""
        cells = [(line, row[k]) for line, row in self.rows for k in columns if k < len(row)]
        if self.separator == "," and not any("," in cell for _, cell in cells):
            return "."
        return decimal_sign(cells, self.dialect)

    def values(self, columns: Sequence[int], time: int | None = None) -> tuple[np.ndarray, list[int]]:
        """Numbers (n, k) of k columns, and the line of each row; rows after the last complete one are a footer.

        time  the column of times; those of a clock, and large ones, count from the first row

        ValueError: a cell is no finite number, with its line and column.
        """
        clock = time is not None and any(time < len(row) and is_clock(row[time]) for _, row in self.rows)
        decimal = self.decimal([k for k in columns if not (clock and k == time)])
        numbers = [[_cell(row, k, decimal, clock and k == time) for k in columns] for _, row in self.rows]
        last, first = len(numbers), int(np.argmin(columns))
        while last and (numbers[last - 1][first] is None or not any(map(_finite, numbers[last - 1]))):
            last -= 1
        texts = [row for _, row in self.rows[last:] if all(k < len(row) and _is_text(row[k]) for k in columns)]
        if 0 < last < len(numbers) and all(map(_finite, numbers[last - 1])) and len(texts) <= MOST_FOOTER:
            begin, end = self.rows[last][0], self.rows[-1][0]
            lines = f"line {begin} is" if begin == end else f"lines {begin} to {end} are"
            self.skipped.append(f"{lines} after the table: not read")
            numbers = numbers[:last]
        for (line, row), values in zip(self.rows, numbers, strict=False):
            self._check_count(line, row)
            for k, value in zip(columns, values, strict=True):
                if _finite(value):
                    continue
                found = row[k].strip() if k < len(row) else ""
                wanted = (
                    "a finite number"
                    if value is not None
                    else f"a number with a decimal {'comma' if decimal == ',' else 'point'}"
                )
                cure = "; correct the row or delete it" if found else "; fill it, or delete the row"
                where = f"row {line}, column {self.cells[k].strip()!r}"
                raise ValueError(f"{where}: found {found!r}, expected {wanted}{cure}")
        table, rows = np.array(numbers, float).reshape(-1, len(columns)), self.rows[: len(numbers)]
        if time is not None and len(table):
            column = columns.index(time)
            table[:, column] = self._times(time, [(n, row[time]) for n, row in rows], table[:, column], clock, decimal)
        return table, [line for line, _ in rows]

    def _times(
        self, k: int, cells: Sequence[tuple[int, str]], read: np.ndarray, clock: bool, decimal: str
    ) -> np.ndarray:
        """The times (n,) of column k in its unit, which is entered in `clocks` if the cells show it."""
        name = self.cells[k].strip()
        if clock:
            self.clocks[k] = "s"
            self.skipped.append(f"column {name!r} has times of day: they count from the first row")
            return clock_seconds(cells)
        days = not self.units.of(k) and are_days(read)
        if not days and not np.abs(read).max() > LARGE:
            return read
        exact = from_first([with_point(cell, decimal) for _, cell in cells])
        if days:
            self.clocks[k] = "s"
            self.skipped.append(f"column {name!r} has no unit; as dates its numbers are days")
            return DAY * exact
        unit = "" if self.units.of(k) else stamp_unit(float(read[0]))
        if unit:
            self.clocks[k] = unit
            self.skipped.append(f"column {name!r} has no unit; as dates its numbers are {unit} since 1970")
        return exact

    def _check_count(self, line: int, row: Sequence[str]) -> None:
        """ValueError: a row has cells without a column, so that cells and columns may be shifted."""
        count = len(self.cells)
        if any(cell.strip() for cell in row[count:]) or (self.separator == BLANK and len(row) != count):
            cure = {
                ",": "decimal commas? Separate the columns by semicolons or tabs, and name each column",
                BLANK: "write names without blanks, or in quotation marks",
            }.get(self.separator, "name each column")
            raise ValueError(f"row {line}: {len(row)} cells, the header in row {self.line} has {count}; {cure}")


def _cell(row: Sequence[str], k: int, decimal: str, clock: bool) -> float | None:
    """The number in a cell, 0 for a time of day; None: it is none."""
    if k >= len(row):
        return None
    return 0.0 if clock and is_clock(row[k]) else number(row[k], decimal)


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _is_text(cell: str) -> bool:
    return bool(cell.strip()) and number(cell) is None


def coarse_step(times: np.ndarray) -> float:
    """Median time [s] between the rows (n) of a long table if it is so long that the unit must be another one; else
    0."""
    step = float(np.median(np.abs(np.diff(times)))) if len(times) > FEW else 0.0
    return step if step >= COARSE else 0.0


def read_table(path: str | Path, score: Callable[[Sequence[str]], int], full: int, dialect: str | None = None) -> Table:
    """The table of a file. Its header is the first line whose cells have a score of `full`, else the best line.

    score    number of needed columns in the cells of a header; see `split_unit`
    dialect  one of `table_numbers.DIALECTS`, "" to detect it, None if the caller has no such option

    OSError, ValueError: it cannot be read, with the reason and the line, or an unknown dialect.
    """
    check_dialect(dialect)
    numbered = [(n, line) for n, line in enumerate(text_lines(path), 1) if line.strip().strip(",;|\t ")]
    body = [(n, line) for n, line in numbered if not REMARK.match(line)]
    comments = [(n, COMMENT.sub("", line, count=1)) for n, line in numbered if REMARK.match(line)]
    if not body and not comments:
        raise ValueError("empty")
    at, text, separator = _find_header([*body, *comments], body, score, full)
    cells = split_row(at, text, separator)
    if not cells:
        raise ValueError("empty")
    if body and not texts_of(cells):  # no header: columns by number
        rows = [(n, split_row(n, line, separator)) for n, line in body if n >= at]
        cells = [f"column {k + 1}" for k in range(len(rows[0][1]))]
        return Table(at, cells, Units(at, cells), rows, separator, dialect)
    rest = [(n, line) for n, line in body if n > at]
    cells, rows_by = _columns_of_rows(cells, text, separator, rest)
    above = [(n, line) for n, line in body if n < at]
    return _below_header(Units(at, cells), text, rows_by, dialect, rest, [*above, *comments])


def _find_header(
    lines: Sequence[tuple[int, str]], body: Sequence[tuple[int, str]], score: Callable[[Sequence[str]], int], full: int
) -> tuple[int, str, str]:
    """Line, text and separator of the header: the first line with a score of `full`, else the best one."""
    best = (-1, 0, "", "")  # score, line, text, separator
    numbers = [(n, text) for n, text in body if NUMBER.match(text)]
    begins = [n for n, _ in numbers]
    for at, line in lines:
        if best[0] >= full:
            break
        if best[0] >= 0 and not re.search(r"[^\W\d_]", re.sub(r"(?i)\d[eE][+-]?\d|nan|inf", "", line)):
            continue  # a row of numbers
        row = next((text for _, text in numbers[bisect(begins, at) :][:1]), "")
        for separator, cells in _divided(line, row).items():
            found = score(cells)
            if found > best[0]:
                best = (found, at, line, separator)
    return _before_numbers(body, score, best)[1:]


def _divided(line: str, row: str) -> dict[str, list[str]]:
    """Separator -> the cells of a line above a row of numbers, of those but blanks that give as many cells in both,
    else of all: blanks and commas may also divide names and units."""
    out: dict[str, list[str]] = {}
    for separator in SEPARATORS:
        if separator in (BLANK, ",") or separator in line:
            try:
                out[separator] = split_cells(line, separator)
            except ValueError:
                out[separator] = [line]
    return {s: cells for s, cells in out.items() if s != BLANK and 1 < len(cells) == row_count(row, s)} or out


def _columns_of_rows(
    cells: list[str], text: str, separator: str, rest: Sequence[tuple[int, str]]
) -> tuple[list[str], str]:
    """Cells of the header, and the separator of the rows. Rows may have another separator than the header, and a comma
    in a name may separate its unit."""
    if not rest:
        return cells, separator
    begin = next((line for _, line in rest if NUMBER.match(line)), rest[0][1])
    others = [s for s in (separator, *SEPARATORS) if s in (BLANK, separator) or s in begin]
    counts = {s: len(split_row(rest[0][0], begin, s)) for s in others}
    parts = {s: len(join_units(cells, text, c)) for s, c in counts.items()}
    rows_by = next((s for s in others if counts[s] == parts[s]), separator)
    cells = join_units(cells, text, counts[rows_by])
    return (["", *cells] if _has_row_names(rest, rows_by, len(cells)) else cells), rows_by


def _below_header(
    units: Units, text: str, separator: str, dialect: str | None, rest: list[tuple[int, str]],
    others: Sequence[tuple[int, str]],
) -> Table:  # fmt: skip
    """The table below a header with this text; `others` are the lines above it and the comments."""
    below, skip = _units_below(rest, separator, len(units.cells))
    if below:
        units.add_row(rest[skip - 1][0], below)
        rest = rest[skip:]
    first = rest[0][0] if rest else math.inf
    for n, line in others:
        if n < first and n != units.line:
            units.add_text(n, line)
    rows, blocks = _without_titles(rest, separator, text.strip(), len(units.cells))
    if blocks and below:
        for n, row in rows:
            if are_units(row):
                units.add_row(n, row)
        rows = [(n, row) for n, row in rows if not are_units(row)]
    table = Table(units.line, units.cells, units, rows, separator, dialect, blocks)
    for n, row in rows[:MOST_BELOW]:  # BEGIN of Igor, the rule of a table in Markdown
        if re.search(r"\d", "".join(row)) or len(rows) == 1:
            break
        table.skipped.append(f"line {n} is above the numbers: not read")
    table.rows = rows[len(table.skipped) :]
    return table


def _before_numbers(
    body: Sequence[tuple[int, str]], score: Callable[[Sequence[str]], int], best: tuple[int, int, str, str]
) -> tuple[int, int, str, str]:
    """The header (score, line, text, separator): the last line before the numbers with the score of the best one, since
    lines above it may match too (columns by number); if no line has a name, the last one before the first numbers."""
    found, at, line, _ = best
    if is_row(cells_of(line)[0]):
        return best
    for n, text in body:
        if n <= at and found > 0:
            continue
        cells, separator = cells_of(text)
        if is_row(cells):
            break
        row = next((line for m, line in body if m > n and NUMBER.match(line)), "")
        divided = _divided(text, row)
        if separator not in divided:
            separator = max(divided, key=lambda s: score(divided[s]))
        if score(divided[separator]) >= found and not are_units(divided[separator]):
            best = (found, n, text, separator)
    return best


def _has_row_names(rest: Sequence[tuple[int, str]], separator: str, count: int) -> bool:
    """Whether the rows begin with "1", "2", "3" in a column that the header (count) lacks, as those of R."""
    rows = [split_row(n, line, separator) for n, line in rest[:3]]
    return len(rows) == 3 and all(
        len(row) == count + 1 and row[0] == str(k + 1) and line.lstrip().startswith('"')
        for k, (row, (_, line)) in enumerate(zip(rows, rest, strict=False))
    )


def _without_titles(
    rest: Sequence[tuple[int, str]], separator: str, head: str, count: int
) -> tuple[list[tuple[int, list[str]]], tuple[int, ...]]:
    """The rows without repeated headers (count cells) and the lines of text above these, and their lines."""
    rows: list[tuple[int, list[str]]] = []
    again: list[int] = []
    for n, line in rest:
        if line.strip() != head:
            rows.append((n, split_row(n, line, separator)))
            continue
        again.append(n)
        titles = 0
        while rows and not is_row(cells := rows[-1][1]):
            if len(cells) == count:  # may be rows of a sensor that failed
                titles += 1
                if titles > MOST_BELOW or len(texts_of(cells)) < len(cells):
                    break
            rows.pop()
    return rows, tuple(again)


def _units_below(rest: Sequence[tuple[int, str]], separator: str, count: int) -> tuple[list[str], int]:
    """A row of units (count) before the first numbers, and the number of lines up to it; empty: no such row."""
    for skip, (line, text) in enumerate(rest[:MOST_BELOW], 1):
        cells = split_row(line, text, separator)
        if any(number(cell) is not None for cell in cells):
            break
        if len(cells) <= count and are_units(cells):
            return cells + [""] * (count - len(cells)), skip
    return [], 0
