"""The command line of the scripts in this folder."""

from __future__ import annotations

import argparse
from pathlib import Path


def parser(about: str | None) -> argparse.ArgumentParser:
    """A parser without arguments; `about`: the docstring of the script."""
    return argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)


def folder(about: str | None) -> Path:
    """The folder for the pictures, by default this one."""
    given = parser(about)
    given.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent, help="folder for the pictures")
    return given.parse_args().folder
