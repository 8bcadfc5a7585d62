"""Which rows of a table belong together: columns that name a press, a specimen or an indenter, and repeated headers."""

import re
from collections.abc import Sequence

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.physics.table_file import Table
from palpate.physics.table_numbers import number

PRESSES = (
    "subject", "session", "press", "specimen", "sample", "person", "finger", "test", "run", "trial", "repeat",
    "repetition", "replicate", "curve", "indent", "experiment", "measurement", "site", "location",
)  # fmt: skip
"""Columns whose values separate the presses of a table, in the order of their names."""
NAMED = ("subject", "session", "press")  # part of the name of a press also where all rows have the same value
BODIES = ("subject", "specimen", "sample", "person", "finger")  # those that name what is pressed
INDENTERS = ("indenter", "probe", "tip", "ball", "cantilever", "radius", "diameter", "tip radius", "tip diameter")
"""Columns that identify the indenter; a file with several values mixes several indenters."""
ADDED = ("id", "no", "nr", "num", "number", "name", "label", "index", "code")  # words that a name may end in
LEAST_ROWS = 10  # fewer rows of each value: the column counts rows
LOW, RISE = 0.3, 0.5
"""[1] First depth of a block over the range, up to which it begins above the surface, and its least rise."""


def plain_name(name: str) -> str:
    """`Specimen ID`, `specimenId`, `Specimen_No.` as `specimen`."""
    words = re.split(r"[\s_.\-#:]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold())
    kept = [word for word in words if word and word not in ADDED]
    return " ".join(kept)


def columns_named(table: Table, names: Sequence[str]) -> dict[str, int]:
    """Plain name -> column, of the columns with one of these names that have several values."""
    plain = [plain_name(name) for name in table.names]
    found = {name: plain.index(name) for name in names if name in plain}
    return {name: k for name, k in found.items() if len(set(_values(table, k))) > 1 and not _counts_rows(table, k)}


def _values(table: Table, k: int) -> list[str]:
    """Values of a column, one per row; an empty cell has the value above it."""
    out, last = [], ""
    for _, row in table.rows:
        last = (row[k].strip() if k < len(row) else "") or last
        out.append(last)
    return out


def _counts_rows(table: Table, k: int) -> bool:
    """Whether a column counts rows, or measures something in each of them: numbers, most of them used once."""
    values = [value for value in _values(table, k) if value]
    numeric = all(number(value) is not None for value in values)
    return numeric and len(set(values)) * LEAST_ROWS > len(values) and len(set(values)) > 0.5 * len(values)


def check_one_indenter(path: object, table: Table) -> None:
    """SessionError: a column shows that several indenters pressed."""
    for k in columns_named(table, INDENTERS).values():
        several = ", ".join(sorted(filter(None, set(_values(table, k))))[:5])
        raise SessionError(
            f"{path}: column {table.cells[k].strip()!r}: pressed by {several}: two indenters mixed; fit each separately"
        )


def check_one_body(path: object, table: Table, what: str) -> None:
    """SessionError: a column shows that several specimens were measured, of which `what` is fitted."""
    for k in columns_named(table, BODIES).values():
        several = ", ".join(list(dict.fromkeys(filter(None, _values(table, k))))[:5])
        raise SessionError(
            f"{path}: column {table.cells[k].strip()!r}: found {several}, expected {what}; save the rows of each in "
            "its file"
        )


def press_labels(table: Table, lines: Sequence[int], depth: np.ndarray) -> list[str]:
    """The label of each of n rows: the values of `PRESSES`, and the number of its block if blocks are presses."""
    named = columns_named(table, PRESSES) | {
        name: k
        for name in NAMED
        if (k := next((k for k, n in enumerate(table.names) if plain_name(n) == name), -1)) >= 0
    }
    parts = [_values(table, named[name])[: len(lines)] for name in PRESSES if name in named]
    blocks = block_presses(table, lines, depth)
    if blocks.max(initial=0) > 0:
        parts.append([f"block {k + 1}" for k in blocks])
    return [" ".join(filter(None, row)) for row in zip(*parts, strict=True)] if parts else [""] * len(lines)


def block_presses(table: Table, lines: Sequence[int], depth: np.ndarray) -> np.ndarray:
    """(n,) Number of the press to which each row belongs by repeated headers.

    A block that begins above the surface and rises is a press; others are segments: pause and retraction.
    """
    block = np.searchsorted(np.array(table.blocks), np.array(lines), side="right")
    if not len(depth) or not table.blocks:
        return np.zeros(len(depth), int)
    low, span, press = float(depth.min()), float(np.ptp(depth)), 0
    out = np.zeros(len(depth), int)
    for k in range(int(block.max()) + 1):
        here = depth[block == k]
        if k and len(here) and here[0] <= low + LOW * span and here.max() - here[0] > RISE * span:
            press += 1
        out[block == k] = press
    note = f"{press + 1} presses" if press else "segments of one press"
    table.skipped.append(f"the header is repeated {len(table.blocks)} times: the blocks are read as {note}")
    return out
