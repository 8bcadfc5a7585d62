"""Cells of a line of a table: separators, names with units, and rows of numbers."""

import csv
import re
from collections.abc import Sequence

from palpate.physics.table_numbers import number

BLANK = " "
SEPARATORS = ("\t", ";", ",", "|", BLANK)
BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]")
SYMBOL = r"(?:[GMkhdcmµμun]?(?:N|m|s|Pa|g|gf|rad|V|A|Hz|J|W)|deg|°|%|min|h|in|°C)"
COMPOUND = rf"{SYMBOL}(?:\^?[-0-9²³]+)?(?:[/*·]{SYMBOL}(?:\^?[-0-9²³]+)?)*"
AFTER = re.compile(rf"(?P<name>[^,/]*[^,/\s])\s*[,/]\s*(?P<unit>{COMPOUND})")
UNIT = re.compile(rf"[\[(]?\s*(?:-|1|a\.u\.|{COMPOUND})\s*[\])]?")
WORD = re.compile(r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?')
WORDS = {
    "sec": "s", "second": "s", "msec": "ms", "millisecond": "ms", "usec": "us", "microsecond": "us", "minute": "min",
    "meter": "m", "metre": "m", "millimeter": "mm", "millimetre": "mm", "micrometer": "um", "micrometre": "um",
    "micron": "um", "newton": "N", "millinewton": "mN", "micronewton": "uN", "gram-force": "gf", "grams-force": "gf",
    "inch": "in", "inche": "in", "thou": "mil", "degree": "deg",
}  # fmt: skip


def split_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a header cell; the unit is "" if it has none."""
    cell = cell.strip().strip("\"'").strip()
    match = BRACKETS.fullmatch(cell) or AFTER.fullmatch(cell)
    return (match["name"].strip(), plain_unit(match["unit"])) if match else (cell, "")


def split_cells(line: str, separator: str) -> list[str]:
    """The cells of a line. ValueError: no row of a table."""
    if separator == BLANK:
        return [word.strip('"') for word in WORD.findall(line)]
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise ValueError(f"not a row of a CSV file: {error}") from None


def split_row(line: int, text: str, separator: str) -> list[str]:
    try:
        return split_cells(text, separator)
    except ValueError as error:
        raise ValueError(f"row {line}: {error}") from None


def cells_of(text: str) -> tuple[list[str], str]:
    """The cells of a line by its most frequent separator, and this separator."""
    separator = max(SEPARATORS[:-1], key=text.count)
    separator = separator if separator in text else BLANK
    try:
        return split_cells(text, separator), separator
    except ValueError:
        return [text], separator


def join_units(cells: list[str], text: str, count: int) -> list[str]:
    """Header cells with units joined to their names, `Fz, gf`, if the rows have only `count` cells."""
    joined: list[str] = []
    for cell in cells:
        if joined and f", {cell}" in text and UNIT.fullmatch(cell) and not split_unit(joined[-1])[1]:
            joined[-1] = f"{joined[-1]}, {cell}"
        else:
            joined.append(cell)
    return joined if len(joined) == count < len(cells) else cells


def is_row(cells: Sequence[str]) -> bool:
    """Whether half of the cells or more are numbers, two or more."""
    filled = [cell for cell in cells if cell.strip()]
    count = len(filled) - len(texts_of(filled))
    return count > 1 and 2 * count >= len(filled)


def texts_of(cells: Sequence[str]) -> list[str]:
    return [cell for cell in cells if number(cell) is None and number(cell, ",") is None]


def are_units(cells: list[str]) -> bool:
    filled = [cell.strip() for cell in cells if cell.strip()]
    return bool(filled) and all(
        number(cell) is None and (UNIT.fullmatch(cell) or plain_unit(cell) != cell.strip("[]() ")) for cell in filled
    )


def plain_unit(cell: str) -> str:
    """A unit without brackets; one that is written as a word by its symbol."""
    unit = cell.strip("[]() ")
    return WORDS.get(unit.lower().removesuffix("s"), unit)
