"""What a recording says of its run: graph as resolved, versions, machine, commit."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

from palpate.launch.loading.plan import Plan

PACKAGES = ("palpate", "numpy", "scipy", "numba", "pyzmq", "msgspec", "mcap")


def about(plan: Plan, **more: object) -> dict[str, object]:
    """Provenance of a run as plain data; `more` is added."""
    spec = plan.to_spec()
    for node in spec["nodes"]:
        if node["name"] in plan.observers and "path" in node["settings"]:
            # Where the recording lies is no property of the run.
            node["settings"] = {**node["settings"], "path": Path(node["settings"]["path"]).name}
    return {
        "plan": spec,
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        "machine": {
            "system": platform.platform(),
            "architecture": platform.machine(),
            "libc": " ".join(platform.libc_ver()),
            "processor": _processor(),
            "cores": os.cpu_count(),
            "byte order": sys.byteorder,
        },
        "commit": _commit(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        **more,
    }


def rounding(told: dict[str, Any]) -> list[str]:
    """How this machine differs from that of a recording, of which `told` is the provenance, in what decides on the last
    bits of results: empty where the same bytes are to be expected."""
    machine, versions = told.get("machine", {}), told.get("versions", {})
    pairs = {
        "architecture": (machine.get("architecture"), platform.machine()),
        "processor": (machine.get("processor"), _processor()),
        "libc": (machine.get("libc"), " ".join(platform.libc_ver())),
        **{name: (versions.get(name), _version(name)) for name in ("numpy", "scipy", "numba")},
    }
    return [f"{name} {then}, here {here}" for name, (then, here) in pairs.items() if then != here]


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.partition(":")[2].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()


def _commit() -> str | None:
    """The commit of the working directory, if it is under git."""
    try:
        found = subprocess.run(
            ["git", "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=2,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() or None
