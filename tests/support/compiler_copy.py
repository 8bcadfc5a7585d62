"""A copy of the compiler and of what it imports, in which a test may change and add kernels."""

import shutil
from pathlib import Path

import palpate.compiler
import palpate.registry


def copy_compiler(folder: Path) -> Path:
    """Copy it to folder/palpate, and return the folder of the compiler there."""
    to = folder / "palpate"
    skipped = shutil.ignore_patterns("__pycache__", "compiled")
    compiler = Path(shutil.copytree(palpate.compiler.__path__[0], to / "compiler", ignore=skipped))
    shutil.copy(palpate.registry.__file__, to)
    (to / "__init__.py").touch()
    return compiler
