"""Tables of numbers as instruments, spreadsheets and robots write them: encoding, separator, header, decimal sign.

The header is the first line in which the caller recognises all columns that it needs; lines before it are skipped, and
so is a footer. Recognised: UTF-8, UTF-16, and Latin-1; separators tab, semicolon, comma and blanks; `name [unit]`,
`name (unit)`, `name, unit`, `name/unit`, or a row of units below the header; a header in a comment (`numpy.savetxt`,
JPK, `%` of MATLAB); blocks that repeat the header (segments of a press). `table_numbers` reads the numbers. Every fault
names its line.
"""

import codecs
import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.physics.readable import MOST_TEXT, check_readable
from palpate.physics.table_numbers import check_dialect, decimal_sign, number

BLANK = " "
SEPARATORS = ("\t", ";", ",", BLANK)
BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]")
SYMBOL = r"(?:[GMkhdcmµμun]?(?:N|m|s|Pa|g|gf|rad|V|A|Hz|J|W)|deg|°|%|min|h|in|°C)"
COMPOUND = rf"{SYMBOL}(?:\^?[-0-9²³]+)?(?:[/*·]{SYMBOL}(?:\^?[-0-9²³]+)?)*"
AFTER = re.compile(rf"(?P<name>[^,/]*[^,/\s])\s*[,/]\s*(?P<unit>{COMPOUND})")
UNIT = re.compile(rf"[\[(]?\s*(?:-|1|a\.u\.|{COMPOUND})\s*[\])]?")
WORD = re.compile(r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?')
CONTROL = re.compile(r"[\0-\x08\x0e-\x1f]")
REMARK = re.compile(r"\s*(?:#|%|//)")
COMMENT = re.compile(r"\s*(?:#+|%+|/{2,}) *(?:columns\s*:)?\s*?")
WORDS = {
    "sec": "s", "second": "s", "msec": "ms", "millisecond": "ms", "usec": "us", "microsecond": "us", "minute": "min",
    "meter": "m", "metre": "m", "millimeter": "mm", "millimetre": "mm", "micrometer": "um", "micrometre": "um",
    "micron": "um", "newton": "N", "millinewton": "mN", "micronewton": "uN", "gram-force": "gf", "degree": "deg",
}  # fmt: skip
MOST_FOOTER = 5  # Rows of text in all needed columns; more of them are a sensor that failed
COARSE, FEW = 0.5, 20
"""[s] Median time between the rows of a longer table than `FEW` rows, from which on its unit must be given."""
MOST_BELOW = 3  # lines between the header and its units


@dataclass
class Table:
    """Rows of a file: (line, cells), and its header with one name and unit ("" if it has none) per column.

    cells    header cells as in the file
    line     line of the header
    skipped  notes on lines that were not read
    """

    line: int
    cells: list[str]
    names: list[str]
    units: list[str]
    rows: list[tuple[int, list[str]]]
    separator: str
    dialect: str | None = ""
    skipped: list[str] = field(default_factory=list)

    def decimal(self, columns: Sequence[int]) -> str:
        """Decimal sign of these columns. ValueError: comma and point are equally likely."""
        cells = [(line, row[k]) for line, row in self.rows for k in columns if k < len(row)]
        if self.separator == "," and not any("," in cell for _, cell in cells):
            return "."
        return decimal_sign(cells, self.dialect)

    def values(self, columns: Sequence[int]) -> tuple[np.ndarray, list[int]]:
        """Numbers (n, k) of k columns, and the line of each row; rows after the last complete one are a footer.

        ValueError: a cell is no finite number, with its line and column.
        """
        decimal = self.decimal(columns)
        numbers = [[number(row[k], decimal) if k < len(row) else None for k in columns] for _, row in self.rows]
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
                raise ValueError(f"row {line}, column {self.cells[k].strip()!r}: found {found!r}, expected {wanted}")
        return np.array(numbers, float).reshape(-1, len(columns)), [line for line, _ in self.rows[: len(numbers)]]

    def _check_count(self, line: int, row: Sequence[str]) -> None:
        """ValueError: a row has cells without a column, so that cells and columns may be shifted."""
        count = len(self.cells)
        if any(cell.strip() for cell in row[count:]) or (self.separator == BLANK and len(row) != count):
            cure = {
                ",": "decimal commas? Separate the columns by semicolons or tabs, and name each column",
                BLANK: "write names without blanks, or in quotation marks",
            }.get(self.separator, "name each column")
            raise ValueError(f"row {line}: {len(row)} cells, the header in row {self.line} has {count}; {cure}")


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _is_text(cell: str) -> bool:
    return bool(cell.strip()) and number(cell) is None


def coarse_step(times: np.ndarray) -> float:
    """Median time [s] between the rows (n) of a long table if it is so long that the unit must be another one; else
    0."""
    step = float(np.median(np.abs(np.diff(times)))) if len(times) > FEW else 0.0
    return step if step >= COARSE else 0.0


def text_lines(path: str | Path) -> list[str]:
    """The lines of a text file. OSError, ValueError: it cannot be read, or is no text."""
    check_readable(path, MOST_TEXT)
    raw = Path(path).read_bytes().rstrip(b"\x1a")  # end of file in DOS
    if raw.startswith(b"PK\3\4"):
        raise ValueError("a zip archive or workbook (.xlsx); save its table as CSV")
    head = raw[:1000]
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif head.count(0) > len(head) // 4:  # Latin letters in UTF-16 without a byte order mark
        encodings = ["utf-16-be" if head[:1] == b"\0" else "utf-16-le"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        if not CONTROL.search(text):
            return lines
        at, found = next((n, mark) for n, line in enumerate(lines, 1) for mark in CONTROL.findall(line))
        raise ValueError(f"not a text file in UTF-8, UTF-16 or Latin-1: found the character {found!r} in row {at}")
    raise ValueError("not a text file in UTF-8, UTF-16 or Latin-1")


def split_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a header cell; the unit is "" if it has none."""
    cell = cell.strip().strip('"').strip()
    match = BRACKETS.fullmatch(cell) or AFTER.fullmatch(cell)
    return (match["name"].strip(), _plain_unit(match["unit"])) if match else (cell, "")


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a line. ValueError: no row of a table."""
    if separator == BLANK:
        return [word.strip('"') for word in WORD.findall(line)]
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise ValueError(f"not a row of a CSV file: {error}") from None


def _join_units(cells: list[str], text: str, count: int) -> list[str]:
    """Header cells with units joined to their names, `Fz, gf`, if the rows have only `count` cells."""
    joined: list[str] = []
    for cell in cells:
        if joined and f", {cell}" in text and UNIT.fullmatch(cell) and not split_unit(joined[-1])[1]:
            joined[-1] = f"{joined[-1]}, {cell}"
        else:
            joined.append(cell)
    return joined if len(joined) == count < len(cells) else cells


def read_table(path: str | Path, score: Callable[[Sequence[str]], int], full: int, dialect: str | None = None) -> Table:
    """The table of a file. Its header is the first line whose cells have a score of `full`, else the best line.

    score    number of needed columns in the cells of a header; see `split_unit`
    dialect  one of `table_numbers.DIALECTS`, "" to detect it, None if the caller has no such option

    OSError, ValueError: it cannot be read, with the reason and the line, or an unknown dialect.
    """
    check_dialect(dialect)
    numbered = [(n, line) for n, line in enumerate(text_lines(path), 1) if line.strip().strip(",;\t ")]
    body = [(n, line) for n, line in numbered if not REMARK.match(line)]
    comments = [(n, COMMENT.sub("", line, count=1)) for n, line in numbered if REMARK.match(line)]
    if not body and not comments:
        raise ValueError("empty")
    best = (-1, 0, "", "")  # score, line, text, separator
    for at, line in [*body, *comments]:
        if best[0] >= full:
            break
        if best[0] >= 0 and not re.search(r"[^\W\d_]", re.sub(r"(?i)\d[eE][+-]?\d|nan|inf", "", line)):
            continue  # a row of numbers
        for separator in SEPARATORS:
            if separator != BLANK and separator not in line and separator != ",":
                continue
            try:
                cells = _cells(line, separator)
            except ValueError:
                cells = [line]
            found = score(cells)
            if found > best[0]:
                best = (found, at, line, separator)
    _, at, text, separator = best
    cells = _split(at, text, separator)
    if not cells:
        raise ValueError("empty")
    if body and all(number(cell) is not None for cell in cells):  # no header: columns by number
        rows = [(n, _split(n, line, separator)) for n, line in body if n >= at]
        cells = [f"column {k + 1}" for k in range(len(rows[0][1]))]
        return Table(at, cells, cells, [""] * len(cells), rows, separator, dialect)
    rest = [(n, line) for n, line in body if n > at]
    begin = next((line for _, line in rest if re.match(r'\s*"?[+-]?[.,]?\d', line)), rest[0][1] if rest else "")
    # rows may have another separator than the header, and a comma in a name may separate its unit
    if rest:
        others = [s for s in (separator, *SEPARATORS) if s in (BLANK, separator) or s in begin]
        counts = {s: len(_split(rest[0][0], begin, s)) for s in others}
        parts = {s: len(_join_units(cells, text, c)) for s, c in counts.items()}
        rows_by = next((s for s in others if counts[s] == parts[s]), separator)
        cells = _join_units(cells, text, counts[rows_by])
    else:
        rows_by = separator
    names, units = [list(part) for part in zip(*map(split_unit, cells), strict=True)]
    # a row of units below the header, or in a comment
    below, skip = _units_below(rest, rows_by, len(cells))
    noted = next((line for n, line in comments if n > at and re.match(r"units?\s*:", line)), "")
    if noted and not any(units):
        given = re.sub(r"units?\s*:\s*", "", noted).split()
        units = given if len(given) == len(names) else units
    elif below:
        units = [unit or _plain_unit(cell) for unit, cell in zip(units, below, strict=True)]
        rest = rest[skip:]
    heads = {text.strip()}
    rows = [(n, _split(n, line, rows_by)) for n, line in rest if line.strip() not in heads]
    again = len(rest) - len(rows)
    if again and below:
        rows = [(n, row) for n, row in rows if not _are_units(row)]
    table = Table(at, cells, names, units, rows, rows_by, dialect)
    if again:
        table.skipped.append(f"the header is repeated {again} times: the blocks are read as segments of one press")
    return table


def _split(line: int, text: str, separator: str) -> list[str]:
    try:
        return _cells(text, separator)
    except ValueError as error:
        raise ValueError(f"row {line}: {error}") from None


def _units_below(rest: Sequence[tuple[int, str]], separator: str, count: int) -> tuple[list[str], int]:
    """A row of units (count) before the first numbers, and the number of lines up to it; empty: no such row."""
    for skip, (line, text) in enumerate(rest[:MOST_BELOW], 1):
        cells = _split(line, text, separator)
        if any(number(cell) is not None for cell in cells):
            break
        if len(cells) <= count and _are_units(cells):
            return cells + [""] * (count - len(cells)), skip
    return [], 0


def _are_units(cells: list[str]) -> bool:
    filled = [cell.strip() for cell in cells if cell.strip()]
    return bool(filled) and all(
        number(cell) is None and (UNIT.fullmatch(cell) or _plain_unit(cell) != cell.strip("[]() ")) for cell in filled
    )


def _plain_unit(cell: str) -> str:
    """A unit without brackets; one that is written as a word by its symbol."""
    unit = cell.strip("[]() ")
    return WORDS.get(unit.lower().removesuffix("s"), unit)
