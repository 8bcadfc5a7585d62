"""The bytecode that the set-up writes."""

import importlib.util
import os
import py_compile
import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import pytest

from palpate.cli.machine.bytecode import unwritten

ROOT = Path(__file__).parents[2]


def module(file):
    made = ModuleType(file.stem)
    made.__spec__ = ModuleSpec(file.stem, None, origin=str(file))
    return made


def test_a_module_without_valid_bytecode_is_found(tmp_path):
    """Missing, older than its source, of another length, of another Python, cut short; a built-in one has no source."""
    files = {name: tmp_path / f"{name}.py" for name in ("good", "none", "older", "longer", "foreign", "cut", "hashed")}
    for name, file in files.items():
        file.write_text("x = 1\n", encoding="utf-8")
        if name == "hashed":
            py_compile.compile(str(file), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
        elif name != "none":
            py_compile.compile(str(file))
    os.utime(files["older"], (1e9, 1e9))
    kept = files["longer"].stat()
    files["longer"].write_text("x = 10\n", encoding="utf-8")
    os.utime(files["longer"], (kept.st_atime, kept.st_mtime))
    for name, change in (("foreign", lambda data: b"\0\0\0\0" + data[4:]), ("cut", lambda data: data[:7])):
        cached = Path(importlib.util.cache_from_source(str(files[name])))
        cached.write_bytes(change(cached.read_bytes()))
    modules = [*map(module, files.values()), sys, ModuleType("bare")]
    assert unwritten(modules) == ["cut", "foreign", "longer", "none", "older"]


@pytest.mark.long
def test_after_the_set_up_a_run_with_pictures_parses_no_source(tmp_path):
    """With an empty folder of bytecode, as after an installation; the run may write none."""
    pytest.importorskip("pyvista")
    environment = os.environ | {"PYTHONPYCACHEPREFIX": str(tmp_path)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    write = [sys.executable, "-m", "palpate.cli.machine.bytecode"]
    subprocess.run([*write, str(ROOT / "tests/golden/kidney.mcap")], env=environment, cwd=tmp_path, check=True)
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    done = subprocess.run([*write, "check"], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_set_up_writes_bytecode_where_the_environment_forbids_it():
    """It calls the module without the variable, which every Python process reads when it starts."""
    script = (ROOT / "setup.sh").read_text(encoding="utf-8")
    assert script.index("unset PYTHONDONTWRITEBYTECODE") < script.index("-m palpate.cli.machine.bytecode")
