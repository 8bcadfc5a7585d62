"""Builds the wheel (PEP 517): that of setuptools, with the kernels compiled for this Python and numba on Linux.

`python -m build` calls it; `python -m build -C kernels=aarch64` compiles them for 64-bit ARM on any machine with Linux,
and `python -m build -C kernels=no` leaves the kernels out, so that the wheel fits any machine.
The kernels are compiled from the content of the wheel and stored in `palpate/compiler/compiled`, where palpate looks
before its cache. A checkout without symbolic links builds the same files.
"""

import contextlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403

PLATFORMS = {name: f"manylinux_2_17_{name}" for name in ("x86_64", "aarch64")}
"""Platform tags by the name of the machine. Kernels need no C library; those of numba's wheels are newer."""
SHIPPED = "palpate/compiler/compiled"
LINKED = ("graphs", "launch", "messages", "nodes")  # folders at the top, linked from src/palpate
NEEDED = ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "docs/release", "src")


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Requirements of setuptools and, for the kernels, those of palpate."""
    required = build_meta.get_requires_for_build_wheel(config_settings)
    if not _machine(config_settings):
        return required
    with open("pyproject.toml", "rb") as file:
        return [*required, "wheel>=0.40", *tomllib.load(file)["project"]["dependencies"]]


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    """The name of the wheel in the folder."""
    wheel_directory = os.path.abspath(wheel_directory)
    with _whole_tree():
        name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    machine = _machine(config_settings)
    return _add_kernels(Path(wheel_directory, name), machine) if machine else name


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """The name of the archive of sources in the folder. It contains folders in place of links."""
    sdist_directory = os.path.abspath(sdist_directory)
    with _whole_tree():
        return build_meta.build_sdist(sdist_directory, config_settings)


@contextlib.contextmanager
def _whole_tree() -> Iterator[None]:
    """Build in a folder whose src/palpate has all packages: this one, or a temporary copy if git or an archive has
    written text files in place of the links, as on Windows."""
    if not any(Path("src/palpate", name).is_file() for name in LINKED):
        yield
        return
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary, "palpate")
        for name in NEEDED:
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            if Path(name).is_dir():
                shutil.copytree(name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
            else:
                shutil.copy(name, copy / name)
        for name in LINKED:
            (copy / "src/palpate" / name).unlink()
            shutil.copytree(name, copy / "src/palpate" / name, ignore=shutil.ignore_patterns("__pycache__"))
        with contextlib.chdir(copy):
            yield


def _machine(settings: Any) -> str:
    """The name of the machines for which the wheel contains kernels; empty: it contains none. SystemExit: unknown."""
    wanted = (settings or {}).get("kernels", "yes")
    linux = sys.platform == "linux"
    if wanted == "yes":
        wanted = platform.machine() if linux and not os.environ.get("PALPATE_NATIVE") else "no"
        return wanted if wanted in PLATFORMS else ""
    if wanted not in ("no", *PLATFORMS):
        raise SystemExit(f"-C kernels: found {wanted!r}, expected yes, no, {' or '.join(PLATFORMS)}")
    if wanted != "no" and not linux:
        raise SystemExit(f"-C kernels={wanted}: needs Linux; a wheel without kernels: python -m build -C kernels=no")
    return "" if wanted == "no" else wanted


def _add_kernels(wheel: Path, machine: str) -> str:
    """Replace the wheel by one with kernels for machines of this name; returns its name."""
    other = [] if machine == platform.machine() else [machine]
    with tempfile.TemporaryDirectory() as temporary:
        unpacked, cache = Path(temporary, "wheel"), Path(temporary, "cache")
        _run("wheel", "unpack", str(wheel), "--dest", str(unpacked))
        [content] = unpacked.iterdir()
        environment = {**os.environ, "PYTHONPATH": str(content), "NUMBA_CACHE_DIR": str(cache)}
        environment["PYTHONDONTWRITEBYTECODE"] = "1"
        for words in (["all"], ["copy", str(content / SHIPPED), *other]):
            _run("palpate.cli.machine.kernels", *words, folder=temporary, environment=environment)
        shutil.rmtree(cache)
        _run("wheel", "pack", str(content), "--dest", str(wheel.parent))
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    tags = ["--python-tag", python, "--abi-tag", "none", "--platform-tag", PLATFORMS[machine]]
    return _run("wheel", "tags", "--remove", *tags, str(wheel)).split()[-1]


def _run(module: str, *words: str, folder: str | None = None, environment: Any = None) -> str:
    """The output of a Python module. Errors and progress appear on standard error. SystemExit: it failed."""
    command = [sys.executable, "-m", module, *words]
    done = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"{module} failed, see above; a wheel without kernels: python -m build -C kernels=no")
    return done.stdout
