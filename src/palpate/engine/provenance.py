"""Provenance of a run in its recording: resolved graph, versions, machine, commit."""

import datetime
import functools
import os
import platform
import sys
from pathlib import Path
from typing import Any

from palpate.compiler.arithmetic import in_force
from palpate.engine.plan import Plan
from palpate.physics.extras import package_version

PACKAGES = ("palpate", "pyzmq", "msgspec", "mcap")


def about(plan: Plan, *, here: bool = True, **more: object) -> dict[str, object]:
    """Provenance of a run as plain data; `more` is added. `here`: this process computes, not worker processes."""
    spec = plan.to_spec()
    for node in spec["nodes"]:
        if node["name"] in plan.observers and "path" in node["settings"]:
            # The folder of the recording is not a property of the run.
            node["settings"] = {**node["settings"], "path": Path(node["settings"]["path"]).name}
    return {
        "plan": spec,
        "versions": _versions(PACKAGES),
        "arithmetic": in_force(here=here),
        "machine": {**_machine(), "architecture": platform.machine(), "byte order": sys.byteorder},
        **_moment(),
        **more,
    }


def _machine() -> dict[str, Any]:
    return {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()}


def _moment() -> dict[str, Any]:
    return {"commit": commit(), "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")}


def machine(*packages: str) -> dict[str, Any]:
    """Provenance of a measurement: versions, processor, cores, commit, date."""
    return {**_versions(("palpate", *packages)), "arithmetic": in_force(), **_machine(), **_moment()}


def rounding(recorded: dict[str, Any]) -> list[str]:
    """Differences between this process and the provenance `recorded` that can change the last bits of results; empty:
    the same bytes are expected."""
    then, here = recorded.get("arithmetic"), in_force()
    if not isinstance(then, dict):
        return ["the recording does not contain the versions of its arithmetic"]
    return [
        f"{name} {then.get(name, 'unknown')}, here {here.get(name, 'unknown')}"
        for name in {**then, **here}
        if then.get(name) != here.get(name)
    ]


def made_by(recorded: dict[str, Any] | None) -> str:
    """Version and commit of palpate that wrote a recording with this provenance; None: of this process."""
    if recorded is None:
        version, of = package_version("palpate"), commit()
    else:
        version, of = (recorded.get("versions") or {}).get("palpate"), recorded.get("commit")
    return f"palpate {version or 'unknown'}" + (f" at commit {of[:12]}" if of else "")


def _versions(packages: tuple[str, ...]) -> dict[str, str | None]:
    return {"python": platform.python_version(), **_packages(packages)}


@functools.cache  # reading them takes 2 ms
def _packages(names: tuple[str, ...]) -> dict[str, str | None]:
    return {name: package_version(name) for name in names}


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.partition(":")[2].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()


def commit() -> str | None:
    """The commit of palpate's source; None if git does not track this file, as in an installed package inside another
    repository."""
    return _commit(Path(__file__).resolve())


@functools.cache  # a process keeps the sources that it has imported; git takes 5 ms
def _commit(source: Path) -> str | None:
    if not _git("ls-files", source.name, folder=source.parent):
        return None
    return _git("rev-parse", "HEAD", folder=source.parent) or None


def _git(*what: str, folder: Path) -> str:
    import subprocess

    # A git hook sets variables that name another repository.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        completed = subprocess.run(
            ["git", *what], cwd=folder, env=environment, capture_output=True, text=True, timeout=2, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return completed.stdout.strip()
