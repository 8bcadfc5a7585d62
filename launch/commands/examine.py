"""What of this machine palpate can use: each finding with what to do about it."""

from __future__ import annotations

import ctypes
import importlib.metadata
import importlib.util
import os
import platform
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from palpate.launch.loading.extras import EXTRAS, install

USB = Path("/sys/bus/usb/devices")
DEVICES = {("0403", "cb48"): "Novint Falcon"}
"""Haptic devices by USB vendor and product."""

_PICTURE = (
    "import pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Sphere()); p.screenshot(return_img=True)"
)


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    state  "ok", "note" (palpate runs, with less) or "fault" (it does not run)
    """

    what: str
    state: str
    found: str
    cure: str = ""


def examine(*, pictures: bool = True) -> Iterator[Finding]:
    """Look at everything, one finding after the other. `pictures`: try to draw one, which takes seconds."""
    yield _python()
    yield from _packages()
    if pictures:
        yield _pictures()
    yield _cores()
    yield _fifo()
    yield _memory()
    yield from _usb()


def _python() -> Finding:
    version = platform.python_version()
    right = sys.version_info >= (3, 11)
    return Finding("python", "ok" if right else "fault", version, "" if right else "Install Python 3.11 or newer.")


def _packages() -> Iterator[Finding]:
    for line in importlib.metadata.requires("palpate") or []:
        if "extra ==" in line:
            continue
        name = re.split(r"[\s<>=!~;\[]", line, maxsplit=1)[0]
        version = _version(name)
        detail = f"{version}, ZeroMQ {_zeromq()}" if version and name == "pyzmq" else version
        yield Finding(
            name, "ok" if version else "fault", detail or "not installed", "" if version else f"pip install {name}"
        )
    for extra, packages in EXTRAS.items():
        versions = {name: _version(name) for name in packages}
        lacking = [name for name, version in versions.items() if version is None]
        found = ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
        yield Finding(f"extra {extra}", "note" if lacking else "ok", found, install(extra) if lacking else "")


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _zeromq() -> str:
    import zmq

    return zmq.zmq_version()


def _pictures() -> Finding:
    """In a process of its own: without a display, some builds of VTK end the process."""
    what = "off-screen pictures"
    if importlib.util.find_spec("pyvista") is None:
        return Finding(what, "note", "pyvista is not installed", install("view"))
    try:
        run = subprocess.run([sys.executable, "-c", _PICTURE], capture_output=True, timeout=60)
    except subprocess.TimeoutExpired:
        return Finding(what, "note", "no picture within 60 s", "Install Mesa (libosmesa6 or libegl1).")
    if run.returncode == 0:
        return Finding(what, "ok", "can be drawn")
    return Finding(
        what, "note", f"cannot be drawn (exit code {run.returncode})", "Install Mesa (libosmesa6 or libegl1)."
    )


def _cores() -> Finding:
    cores = sorted(os.sched_getaffinity(0))
    found = f"{len(cores)} usable: {', '.join(map(str, cores))}"
    few = len(cores) < 2
    return Finding("cores", "note" if few else "ok", found, "The force path wants a core to itself." if few else "")


def _fifo() -> Finding:
    """Whether this process may take real-time priority; it is given back at once."""
    policy, given = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        cure = "Add `@realtime - rtprio 99` to /etc/security/limits.conf and yourself to that group; log in again."
        return Finding("SCHED_RR", "note", "not permitted: ticks may be late under load", cure)
    os.sched_setscheduler(0, policy, given)
    return Finding("SCHED_RR", "ok", "permitted")


def _memory() -> Finding:
    """Whether this process may lock its memory; it is given back at once."""
    libc = ctypes.CDLL(None, use_errno=True)
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    words = "no limit" if limit == resource.RLIM_INFINITY else f"limit {limit // 1024} kB"
    if libc.mlockall(1) == 0:  # MCL_CURRENT
        libc.munlockall()
        return Finding("locked memory", "ok", f"permitted, {words}")
    cure = "Add `@realtime - memlock unlimited` to /etc/security/limits.conf; log in again."
    return Finding("locked memory", "note", f"not permitted, {words}: page faults may hold up a tick", cure)


def _usb() -> Iterator[Finding]:
    found = False
    for folder in sorted(USB.glob("*")) if USB.is_dir() else ():
        ids = _word(folder / "idVendor"), _word(folder / "idProduct")
        name = DEVICES.get(ids)
        if name is None:
            continue
        found = True
        numbers = [_word(folder / part) for part in ("busnum", "devnum")]
        node = Path("/dev/bus/usb", *(n.zfill(3) for n in numbers))
        if os.access(node, os.W_OK):
            yield Finding(name, "ok", f"at {node}")
        else:
            cure = (
                f'udev rule: SUBSYSTEM=="usb", ATTR{{idVendor}}=="{ids[0]}", ATTR{{idProduct}}=="{ids[1]}", MODE="0666"'
            )
            yield Finding(name, "note", f"at {node}, not writable for you", cure)
    if not found:
        yield Finding("haptic device", "note", "none on USB", "Nothing to do: device.Simulated runs without one.")


def _word(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""
