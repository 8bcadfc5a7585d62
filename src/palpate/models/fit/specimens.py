"""Which rows of a table belong together: columns that name a press, a specimen or an indenter, and repeated headers.

Presses of one specimen are fitted together, since they repeat one measurement; specimens are fitted one by one.
"""

import re
from collections.abc import Collection, Sequence
from itertools import pairwise

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
SPECIMENS = (*BODIES, "site", "location")
"""Columns whose values are fitted one by one: another body, or another place of it, has another stiffness."""
INDENTERS = ("indenter", "probe", "tip", "ball", "cantilever", "radius", "diameter", "tip radius", "tip diameter")
"""Columns that identify the indenter; a file with several values mixes several indenters."""
PARTS = ("cycle", "loop", "segment", "phase", "step", "stage", "direction", "state", "mode", "ramp", "set", "part")
"""Columns that divide a measurement of one specimen; its first press is fitted."""
ADDED = ("id", "no", "nr", "num", "number", "name", "label", "index", "code")  # words that a name may end in
LEAST_ROWS = 10  # fewer rows of each value: the column counts rows
COUNTING = 0.8  # [1] Share of rows in which a number rises from which on it counts the rows of several parts
LOW, RISE = 0.3, 0.5
"""[1] First depth of a block over the range, up to which it begins above the surface, and its least rise."""


def plain_name(name: str) -> str:
    """`Specimen ID`, `specimenId`, `Specimen_No.` as `specimen`."""
    words = re.split(r"[\s_.\-#:]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold())
    kept = [word for word in words if word and word not in ADDED]
    return " ".join(kept)


def columns_named(table: Table, names: Sequence[str], constant: Sequence[str] = ()) -> list[int]:
    """The columns with one of these names that have several values, in the order of the names; those with a name in
    `constant` also if all rows have the same value."""
    plain = [plain_name(name) for name in table.names]
    return [
        k
        for name in names
        for k, other in enumerate(plain)
        if other == name and (name in constant or len(set(_values(table, k))) > 1) and not counts_rows(table, k)
    ]


def _values(table: Table, k: int) -> list[str]:
    """Values of a column, one per row; an empty cell has the value above it."""
    out, last = [], ""
    for _, row in table.rows:
        last = (row[k].strip() if k < len(row) else "") or last
        out.append(last)
    return out


def counts_rows(table: Table, k: int) -> bool:
    """Whether a column counts or names rows, or measures something in each of them: most values are used once, or they
    rise from row to row in each of several parts."""
    values = [value for value in _values(table, k) if value]
    different = len(set(values))
    if different < 2 or different * LEAST_ROWS <= len(values):
        return False
    numbers = [number(value) for value in values]
    rising = sum(b > a for a, b in pairwise(numbers) if a is not None and b is not None)
    return different > 0.5 * len(values) or (None not in numbers and rising > COUNTING * len(values))


def check_one_indenter(path: object, table: Table) -> None:
    """SessionError: a column shows that several indenters pressed."""
    for k in columns_named(table, INDENTERS):
        several = ", ".join(sorted(filter(None, set(_values(table, k))))[:5])
        raise SessionError(
            f"{path}: column {table.cells[k].strip()!r}: pressed by {several}: two indenters mixed; save the rows of "
            "each in its file, and fit each separately"
        )


def check_unnamed_bodies(path: object, table: Table, used: Collection[int], depth: np.ndarray) -> None:
    """SessionError: a column with a name that is none of `PRESSES`, such as `Organ` or `Mouse`, has a press for each of
    its values, of which only one would be fitted.

    used   columns that are read
    depth  (n,) of all rows
    """
    if not len(depth):
        return
    low, span = float(depth.min()), float(np.ptp(depth))
    for k, name in enumerate(map(plain_name, table.names)):
        values = _values(table, k)[: len(depth)]
        begins = [0, *(i for i in range(1, len(values)) if values[i] != values[i - 1])]
        labels = [values[i] for i in begins]
        known = k in used or name in (*PRESSES, *INDENTERS, *PARTS) or "" in labels
        if known or len(labels) < 2 or len(set(labels)) < len(labels) or LEAST_ROWS * len(labels) > len(depth):
            continue
        parts = np.split(depth, begins[1:])
        if all(len(part) >= LEAST_ROWS and _is_press(part, low, span) for part in parts):
            named = table.names[k] if re.fullmatch(r"\w+", table.names[k]) else str(k + 1)
            named = named if table.names.count(named) == 1 else str(k + 1)
            raise SessionError(
                f"{path}: column {table.cells[k].strip()!r}: found {', '.join(labels[:5])}, with a press for each; "
                f"--columns specimen={named} fits each alone, or save the rows of each in its file"
            )


def _is_press(depth: np.ndarray, low: float, span: float) -> bool:
    """Whether a part (n,) of a record begins above the surface and rises; least depth and range of the record."""
    return bool(depth[0] <= low + LOW * span and depth.max() - depth[0] > RISE * span)


def check_one_body(path: object, table: Table, what: str) -> None:
    """SessionError: a column shows that several specimens were measured, of which `what` is fitted."""
    for k in columns_named(table, BODIES):
        several = ", ".join(list(dict.fromkeys(filter(None, _values(table, k))))[:5])
        raise SessionError(
            f"{path}: column {table.cells[k].strip()!r}: found {several}, expected {what}; save the rows of each in "
            "its file"
        )


def row_labels(
    table: Table, lines: Sequence[int], depth: np.ndarray, specimen: int | None = None, joined: bool = False
) -> tuple[list[str], list[str]]:
    """The labels (n) of press and specimen of each of n rows.

    specimen  the column that names the specimens; None: those of `SPECIMENS`
    joined    all rows count as one specimen

    A press is a combination of values of `PRESSES`, and a block if blocks are presses. Blocks are specimens if no
    column says which presses repeat a measurement. The label of a specimen is "" if nothing names it.
    """
    bodies = columns_named(table, SPECIMENS, SPECIMENS) if specimen is None else [specimen]
    named = columns_named(table, PRESSES, NAMED)
    named = [k for k in bodies if specimen is not None and k not in named] + named
    values = {k: _values(table, k)[: len(lines)] for k in (*named, *bodies)}
    presses, specimens = [values[k] for k in named], [values[k] for k in bodies]
    blocks = block_presses(table, lines, depth)
    if blocks.max(initial=0) > 0:
        presses.append([f"block {k + 1}" for k in blocks])
        if specimen is None and all(len(set(values[k])) < 2 for k in named):
            specimens.append(presses[-1])
    labels = _joined(presses, len(lines)), _joined([] if joined else specimens, len(lines))
    if (count := len(set(labels[1]))) > 1:
        what = " and ".join(repr(table.cells[k].strip()) for k in bodies if len(set(values[k])) > 1)
        where = f"column {what} names" if what else "the blocks below repeated headers are"
        table.skipped.append(f"{where} {count} specimens: each is fitted alone (--columns specimen= fits all as one)")
    return labels


def _joined(parts: Sequence[Sequence[str]], count: int) -> list[str]:
    """The values (n) of columns, one text per row; of no columns empty texts."""
    return [" ".join(filter(None, row)) for row in zip(*parts, strict=True)] if parts else [""] * count


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
        if k and len(here) and _is_press(here, low, span):
            press += 1
        out[block == k] = press
    note = f"{press + 1} presses" if press else "segments of one press"
    table.skipped.append(f"the header is repeated {len(table.blocks)} times: the blocks are read as {note}")
    return out
