"""Options and tables of the benchmarks."""

from __future__ import annotations

import argparse
import json
import sys

from rich.console import Console
from rich.markup import escape
from rich.table import Table


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A parser with `--json`; its description is the first line of a script's docstring."""
    made = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    made.add_argument("--json", action="store_true", help="print JSON for programs")
    return made


def show(title: str, rows: list[dict[str, object]], digits: int = 4) -> None:
    """Print rows; the columns are their keys, in order of first appearance."""
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    names = list(dict.fromkeys(name for row in rows for name in row))
    for name in names:
        table.add_column(escape(name), justify="right")
    for row in rows:
        cells = ["" if row.get(name) is None else row[name] for name in names]
        table.add_row(*(figure(cell, digits) if isinstance(cell, float) else escape(str(cell)) for cell in cells))
    out = Console()
    (out if out.is_terminal else Console(width=200)).print(table)  # in a file or pipe, do not cut columns


def figure(value: float, digits: int) -> str:
    """The value with this number of significant digits; integers up to 1e9 in full, without exponent."""
    return f"{value:.0f}" if 10 ** (digits - 1) <= abs(value) < 1e9 else f"{value:.{digits}g}"


def print_tables(tables: dict[str, list[dict[str, object]]], as_json: bool, digits: int = 4) -> None:
    """Print tables by title, as text or as JSON."""
    if as_json:
        json.dump(tables, sys.stdout, indent=2)
        return
    for title, rows in tables.items():
        show(title, rows, digits)
