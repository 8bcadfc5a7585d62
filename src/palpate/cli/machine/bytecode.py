"""Writes the bytecode of what the commands import, so that no command parses the sources of a library again.

python -m palpate.cli.machine.bytecode RECORDING   import what a run and its pictures import; draw those of a recording
python -m palpate.cli.machine.bytecode check       exit code 1, and the modules of `palpate run kidney` without bytecode

pip can compile all files that it installs, 5000 of them in half a minute, of which the commands import 900. Where
PYTHONDONTWRITEBYTECODE is set, as in containers, no later command would write them; unset it for this one.
"""

import contextlib
import importlib
import importlib.util
import io
import pkgutil
import runpy
import struct
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

ROOMS = ("messages", "compiler", "physics", "engine", "drivers", "nodes", "launch", "records", "views", "cli")
LIBRARIES = ("rich", "yaml", "typer")  # import some of their files when they print or read something
RUN = ("run", "kidney", "--duration", "0.6", "-q")


def import_all() -> None:
    """Import the files of the rooms that a run and its pictures need, and of some libraries; without those that need a
    package that is not installed."""
    names = [info.name for info in pkgutil.iter_modules(sys.modules["palpate"].__path__, "palpate.") if not info.ispkg]
    for name in (*(f"palpate.{room}" for room in ROOMS), *LIBRARIES):
        package = importlib.import_module(name)
        names += [info.name for info in pkgutil.walk_packages(package.__path__, f"{name}.", onerror=lambda _: None)]
    for name in names:
        if name.endswith("__main__"):  # some run their program
            continue
        with contextlib.suppress(Exception):
            importlib.import_module(name)


def unwritten(modules: Iterable[ModuleType]) -> list[str]:
    """Names of the modules that Python would parse again: those of a source file without valid bytecode."""
    names = []
    for module in modules:
        spec = getattr(module, "__spec__", None)
        source = getattr(spec, "origin", None)
        if source is not None and source.endswith(".py") and not _has_bytecode(Path(source)):
            names.append(module.__name__)
    return sorted(names)


def _has_bytecode(source: Path) -> bool:
    """Whether a file has bytecode of this Python, and as old as the file."""
    try:
        head = Path(importlib.util.cache_from_source(str(source))).read_bytes()[:16]
        state = source.stat()
    except OSError:
        return False
    magic, flags, changed, size = struct.unpack("<4sLLL", head) if len(head) == 16 else (b"", 0, 0, 0)
    if magic != importlib.util.MAGIC_NUMBER:
        return False
    return bool(flags) or (changed, size) == (int(state.st_mtime) & 0xFFFFFFFF, state.st_size & 0xFFFFFFFF)


def _call(*words: str) -> None:
    """Run a command in this process, with its modules. SystemExit: it failed."""
    sys.argv = ["palpate", *words]
    try:
        runpy.run_module("palpate.cli", run_name="__main__")
    except SystemExit as end:
        if end.code:
            raise


def _check() -> None:
    """Run the kidney with its pictures, and report the modules without bytecode."""
    with tempfile.TemporaryDirectory() as folder:
        _call(*RUN, "--out", folder)
    lacking = unwritten(list(sys.modules.values()))
    raise SystemExit("\n".join(["modules without bytecode:", *lacking]) if lacking else 0)


def main(words: list[str]) -> None:
    """Write, or check."""
    if words == ["check"]:
        _check()
    import_all()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        _call("check", "kidney")
        _call("picture", words[0], "-o", folder)


if __name__ == "__main__":
    main(sys.argv[1:])
