"""The folder of measurements that the scripts of this folder read.

It is not part of the project, because the measurements have no licence. docs/measured.md gives their sources and the
form of the tables.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from palpate.models.fit.finger import FingerPress, read_presses


def parser(text: str | None) -> argparse.ArgumentParser:
    """Options of each script: the folder, and where to draw."""
    made = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", type=Path, nargs="?", help="folder with the tables of docs/measured.md")
    made.add_argument("-o", "--out", type=Path, help="picture to write")
    return made


def texts(folder: Path | None, name: str, source: str, columns: int) -> list[list[str]]:
    """Cells of a table, the header first. Ends the program with a clear message
    if the folder, the file or its form is not the expected one."""
    if folder is None:
        sys.exit(
            f"{name}: give the folder with the measurements. They are not part of palpate; from {source}, in the form "
            "that docs/measured.md describes"
        )
    path = folder / name
    if not path.is_file():
        sys.exit(f"{path}: does not exist; expected a table of {source}, in the form that docs/measured.md describes")
    lines = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    if len(lines) < 2 or min(map(len, lines)) < columns:
        sys.exit(f"{path}: expected a header and rows with {columns} columns separated by commas or more")
    return lines


def table(folder: Path | None, name: str, source: str, columns: int) -> tuple[list[str], np.ndarray]:
    """Header and rows of a table of numbers, as `texts`; its first column may be text (NaN)."""
    lines = texts(folder, name, source, columns)
    try:
        rows = [[float("nan") if k == 0 and not _is_number(cell) else float(cell) for k, cell in enumerate(line)]
                for line in lines[1:]]  # fmt: skip
    except ValueError as error:
        sys.exit(f"{name}: {error}; expected numbers")
    return lines[0], np.array(rows)


def presses_of_people(folder: Path | None) -> list[list[FingerPress]]:
    """The presses of four people's fingers, as `read_presses` of each file. Ends the program as `texts`."""
    people = []
    for number in range(1, 5):
        table(folder, name := f"finger_F{number}.csv", FINGERS, 3)
        assert folder is not None  # `table` has ended the program
        people.append(read_presses(folder / name))
    return people


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


FINGERS = "https://github.com/nbso13/bensmaia_gelsight_scripts (2021, no licence)"
