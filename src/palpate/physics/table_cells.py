"""Cells of a line of a table: separators, names with units, and rows of numbers."""

import csv
import re
from collections.abc import Sequence

from palpate.physics.table_numbers import number
from palpate.physics.table_times import is_clock
from palpate.units.header import is_unit, split_unit

BLANK = " "
SEPARATORS = ("\t", ";", ",", "|", BLANK)
WORD = re.compile(r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?')


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


def row_count(text: str, separator: str) -> int:
    """Number of cells of a line; 1 if it cannot be divided."""
    try:
        return len(split_cells(text, separator))
    except ValueError:
        return 1


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
        if joined and f", {cell}" in text and is_unit(cell) and not split_unit(joined[-1])[1]:
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
    """Cells that are neither numbers nor times of day."""
    return [cell for cell in cells if number(cell) is None and number(cell, ",") is None and not is_clock(cell)]


def are_units(cells: list[str]) -> bool:
    """Whether all cells that are not empty are units."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    return bool(filled) and all(number(cell) is None and is_unit(cell) for cell in filled)
