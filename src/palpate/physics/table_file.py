"""Tables of numbers as instruments, spreadsheets and robots write them: encoding, separator, header, decimal sign.

The header is the first line in which the caller recognises all columns that it needs; lines before it are skipped, and
so is a footer. Recognised: UTF-8, UTF-16, and Latin-1; separators tab, semicolon, comma and blanks; `name [unit]`,
`name (unit)`, `name, unit`, `name/unit`, or a row of units below the header; a header in a comment (`numpy.savetxt`,
JPK); blocks that repeat the header (segments of a press); decimal commas. Every fault names its line.
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

DIALECTS = ("decimal-comma", "decimal-point")
BLANK = " "
SEPARATORS = ("\t", ";", ",", BLANK)
BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]")
SYMBOL = r"(?:[GMkhdcmµμun]?(?:N|m|s|Pa|g|gf|rad|V|A|Hz|J|W)|deg|°|%|min|h|in|°C)"
COMPOUND = rf"{SYMBOL}(?:\^?[-0-9²³]+)?(?:[/*·]{SYMBOL}(?:\^?[-0-9²³]+)?)*"
AFTER = re.compile(rf"(?P<name>[^,/]*[^,/\s])\s*[,/]\s*(?P<unit>{COMPOUND})")
UNIT = re.compile(rf"[\[(]?\s*(?:-|1|a\.u\.|{COMPOUND})\s*[\])]?")
WORD = re.compile(r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?')
COMMENT = re.compile(r"\s*#+\s*(?:columns\s*:)?\s*")
COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
COMMA_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
POINT_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+,\d*")


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
    dialect: str = ""
    skipped: list[str] = field(default_factory=list)

    def decimal(self, columns: Sequence[int]) -> str:
        """Decimal sign of these columns. ValueError: comma and point are equally likely."""
        if self.dialect:
            return "," if self.dialect == "decimal-comma" else "."
        if self.separator == ",":
            return "."
        commas = [(n, cell) for n, row in self.rows for k in columns if k < len(row) and "," in (cell := row[k])]
        grouped = next(((n, c) for n, c in commas if POINT_THOUSANDS.fullmatch(c.strip())), None)
        numbers = [(n, c.strip()) for n, c in commas if COMMA.fullmatch(c.strip())]
        clear = [pair for pair in numbers if not COMMA_THOUSANDS.fullmatch(pair[1])]
        if clear or grouped:
            return ","
        if numbers and not any("." in row[k] for _, row in self.rows for k in columns if k < len(row)):
            line, cell = numbers[0]
            raise ValueError(
                f"row {line}: found {cell!r}, a decimal comma or a separator of thousands? Set --dialect "
                f"{' or '.join(DIALECTS)}"
            )
        return "."

    def values(self, columns: Sequence[int]) -> tuple[np.ndarray, list[int]]:
        """Numbers (n, k) of k columns, and the line of each row; rows after the last complete one are a footer.

        ValueError: a cell is no finite number, with its line and column.
        """
        comma = self.decimal(columns) == ","
        for line, row in self.rows if self.separator == "," else ():
            if any(cell.strip() for cell in row[len(self.cells) :]):
                raise ValueError(
                    f"row {line}: {len(row)} cells, the header in row {self.line} has {len(self.cells)}; decimal "
                    "commas? Separate the columns by semicolons or tabs"
                )
        numbers = [[_number(row[k], comma) if k < len(row) else None for k in columns] for _, row in self.rows]
        last = len(numbers)
        while last and numbers[last - 1][int(np.argmin(columns))] is None:
            last -= 1
        if 0 < last < len(numbers) and all(v is not None for v in numbers[last - 1]):
            first, end = self.rows[last][0], self.rows[-1][0]
            lines = f"line {first} is" if first == end else f"lines {first} to {end} are"
            self.skipped.append(f"{lines} after the table: not read")
            numbers = numbers[:last]
        for (line, row), values in zip(self.rows, numbers, strict=False):
            for k, value in zip(columns, values, strict=True):
                if value is not None and math.isfinite(value):
                    continue
                found = row[k].strip() if k < len(row) else ""
                wanted = (
                    "a finite number"
                    if value is not None
                    else f"a number with a decimal {'comma' if comma else 'point'}"
                )
                raise ValueError(f"row {line}, column {self.cells[k].strip()!r}: found {found!r}, expected {wanted}")
        return np.array(numbers, float).reshape(-1, len(columns)), [line for line, _ in self.rows[: len(numbers)]]


def number(text: str, decimal: str = ".") -> float | None:
    """A number with this decimal sign; None: the text is no number."""
    return _number(text, decimal == ",")


def _number(text: str, comma: bool) -> float | None:
    text = text.strip()
    if comma:
        text = (text.replace(".", "") if POINT_THOUSANDS.fullmatch(text) else text).replace(",", ".")
    elif "," in text and COMMA_THOUSANDS.fullmatch(text):
        text = text.replace(",", "")
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def text_lines(path: str | Path) -> list[str]:
    """The lines of a text file. OSError, ValueError: it cannot be read, or is no text."""
    check_readable(path, MOST_TEXT)
    raw = Path(path).read_bytes()
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
        if not re.search(r"[\0-\x08\x0e-\x1f]", text):
            return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    raise ValueError("not a text file in UTF-8, UTF-16 or Latin-1")


def split_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a header cell; the unit is "" if it has none."""
    cell = cell.strip().strip('"').strip()
    match = BRACKETS.fullmatch(cell) or AFTER.fullmatch(cell)
    return (match["name"].strip(), match["unit"]) if match else (cell, "")


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


def read_table(path: str | Path, score: Callable[[Sequence[str]], int], full: int, dialect: str = "") -> Table:
    """The table of a file. Its header is the first line whose cells have a score of `full`, else the best line.

    score    number of needed columns in the cells of a header; see `split_unit`
    dialect  one of `DIALECTS`, if the decimal sign cannot be detected

    OSError, ValueError: it cannot be read, with the reason and the line.
    """
    numbered = [(n, line) for n, line in enumerate(text_lines(path), 1) if line.strip().strip(",;\t ")]
    body = [(n, line) for n, line in numbered if not line.lstrip().startswith("#")]
    comments = [(n, COMMENT.sub("", line, count=1)) for n, line in numbered if line.lstrip().startswith("#")]
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
    below = _split(rest[0][0], rest[0][1], rows_by) if rest else []
    noted = next((line for n, line in comments if n > at and re.match(r"units?\s*:", line)), "")
    if noted and not any(units):
        given = re.sub(r"units?\s*:\s*", "", noted).split()
        units = given if len(given) == len(names) else units
    elif below and not any(units) and len(below) <= len(cells) and _are_units(below):
        units = [cell.strip().strip("[]()").strip() for cell in below] + [""] * (len(cells) - len(below))
        rest = rest[1:]
    heads = {text.strip()}
    rows = [(n, _split(n, line, rows_by)) for n, line in rest if line.strip() not in heads]
    again = len(rest) - len(rows)
    if again and below and _are_units(below):
        rows = [(n, row) for n, row in rows if row != below]
    table = Table(at, cells, names, units, rows, rows_by, dialect)
    if again:
        table.skipped.append(f"the header is repeated {again} times: the blocks are read as segments of one press")
    return table


def _split(line: int, text: str, separator: str) -> list[str]:
    try:
        return _cells(text, separator)
    except ValueError as error:
        raise ValueError(f"row {line}: {error}") from None


def _are_units(cells: list[str]) -> bool:
    filled = [cell.strip() for cell in cells if cell.strip()]
    return bool(filled) and all(UNIT.fullmatch(cell) and number(cell) is None for cell in filled)
