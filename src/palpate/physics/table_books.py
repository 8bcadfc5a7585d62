"""Tables in workbooks (.xlsx, by openpyxl) and in files of MATLAB (.mat, by scipy), as lines with tabs."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.claims import check_claim, check_zip, largest_content
from palpate.physics.extras import require_extra

LEAST_ROWS = 4  # Rows of numbers of a sheet or variable that is a table
MOST_COLUMNS = 64
MOST_CELLS = 2_000_000  # of a workbook, 100 bytes each in memory
COMPRESSED = 15  # type of a compressed element of a file of MATLAB (MAT-File Format, level 5, table 1-1)


def workbook_lines(path: str | Path) -> list[str]:
    """The lines of the only sheet of a workbook with numbers. ValueError: it cannot be read, or has several."""
    with require_extra(Path(path).name, "sheets", ValueError):
        import openpyxl
    try:
        check_zip(Path(path))
        with Path(path).open("rb") as file:  # openpyxl refuses some names of files
            book = openpyxl.load_workbook(file, read_only=True, data_only=True)
            sheets = {s.title: _rows(s) for s in book.worksheets}
    except Exception as error:  # openpyxl and zipfile raise errors of many kinds
        raise ValueError(f"a workbook (.xlsx) that cannot be read ({error}); save its table as CSV") from None
    full = [name for name, rows in sheets.items() if sum(map(_is_numeric, rows)) >= LEAST_ROWS]
    if len(full) != 1:
        found = f"numbers in the sheets {', '.join(full)}" if full else "no sheet with rows of numbers"
        raise ValueError(f"a workbook with {found}, expected one sheet with numbers; save it as CSV")
    return ["\t".join(map(_text, row)) for row in sheets[full[0]]]


def _rows(sheet: Any) -> list[list[Any]]:
    """The rows of a sheet. ValueError: it has more than `MOST_CELLS` cells."""
    rows: list[list[Any]] = []
    count = 0
    for row in sheet.iter_rows(values_only=True):
        count += len(row)
        if count > MOST_CELLS:
            raise ValueError(f"the sheet {sheet.title!r} has more than {MOST_CELLS} cells")
        rows.append(list(row))
    return rows


def _is_numeric(row: Iterable[Any]) -> bool:
    return sum(isinstance(value, int | float) for value in row) > 1


def _text(value: Any) -> str:
    """A cell; numbers with an exponent, because `1.234` may have a separator of thousands."""
    if value is None:
        return ""
    if isinstance(value, datetime | date | time):
        return value.isoformat(" ") if isinstance(value, datetime) else value.isoformat()
    if isinstance(value, int | np.integer) or (isinstance(value, float) and value.is_integer() and abs(value) < 1e15):
        return str(int(value))
    if isinstance(value, float):
        return f"{value:.16e}"
    return " ".join(str(value).replace('"', "'").split())


def matlab_lines(path: str | Path) -> list[str]:
    """The variables of a file of MATLAB that are vectors of the same length, or columns of a matrix, with their names.

    ValueError: it cannot be read, or has vectors of several lengths.
    """
    from scipy.io import loadmat  # slow to import

    cure = "save its table as CSV, in MATLAB with writetable(T, 'press.csv')"
    try:
        _check_compressed(Path(path))
        content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    except Exception as error:  # of many kinds, if the file is damaged
        raise ValueError(f"a file of MATLAB (.mat) that cannot be read ({error}); {cure}") from None
    columns: dict[str, np.ndarray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            columns |= _columns(name, value)
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        found = f"variables of {len(lengths)} lengths" if lengths else "no numeric variables"
        raise ValueError(f"a file of MATLAB (.mat) with {found}, expected vectors of one length; {cure}")
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return ["\t".join(columns), *("\t".join(map(_text, row)) for row in rows)]


def _check_compressed(path: Path) -> None:
    """ValueError: the compressed elements of a file of MATLAB unpack to too many bytes. Files of other versions have no
    compressed elements, or are refused by scipy."""
    held = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(128)
        if len(head) < 128 or head[126:] not in (b"IM", b"MI"):
            return
        order, unpacked = "<" if head[126:] == b"IM" else ">", 0
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            begin, inflate = file.tell(), zlib.decompressobj()
            while (
                kind == COMPRESSED and not inflate.eof and (part := file.read(min(1 << 16, begin + size - file.tell())))
            ):
                while part and unpacked <= largest_content(held):
                    unpacked += len(inflate.decompress(part, 1 << 20))
                    part = inflate.unconsumed_tail
                check_claim("its compressed content", unpacked, held)
            file.seek(begin + size)


def _columns(name: str, value: Any) -> dict[str, np.ndarray]:
    """Name -> vector of the numbers of a variable: a vector, the columns of a matrix, the fields of a structure."""
    if hasattr(value, "_fieldnames"):
        found: dict[str, np.ndarray] = {}
        for key in value._fieldnames:
            found |= _columns(key, getattr(value, key))
        return found
    array: Sequence[Any] | np.ndarray = np.asarray(value)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf" or array.ndim not in (1, 2):
        return {}
    if len(array) < LEAST_ROWS:
        return {}
    if array.ndim == 1:
        return {name: array.astype(float)}
    if array.shape[1] > MOST_COLUMNS:
        return {}
    return {f"{name} {k + 1}": array[:, k].astype(float) for k in range(array.shape[1])}
