"""What of this machine palpate can use: each finding with what to do about it."""

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

from palpate.physics.extras import EXTRAS, install

TUNING = (
    "Set the CPU governor to performance (cpupower frequency-set -g performance), keep a core free (isolcpus, and"
    " `core:` in a placement), switch off deep sleep states; give a virtual machine cores of its own."
)
HELD = 0.5e-3  # [s] lateness up to which a millisecond is held

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


def examine(*, pictures: bool = True, seconds: float = 2.0) -> Iterator[Finding]:
    """Look at everything, one finding after the other.

    pictures  try to draw one, which takes seconds
    seconds   [s] for which wake-ups are watched, once without and once with real-time priority; 0: not at all
    """
    yield _python()
    yield from _packages()
    if pictures:
        yield _pictures()
    yield _cores()
    yield _fifo()
    yield _memory()
    if seconds > 0.0:
        yield from _wake_ups(seconds)
    yield from _libusb()
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
        listing = ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
        yield Finding(f"extra {extra}", "note" if lacking else "ok", listing, install(extra) if lacking else "")


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
    listing = f"{len(cores)} usable: {', '.join(map(str, cores))}"
    few = len(cores) < 2
    return Finding("cores", "note" if few else "ok", listing, "The force path needs a core of its own." if few else "")


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
    return Finding("locked memory", "note", f"not permitted, {words}: page faults may delay a tick", cure)


def _usb() -> Iterator[Finding]:
    from palpate.drivers.discover import devices

    attached = False
    for device in devices():
        attached = True
        if device.missing:
            yield Finding(device.name, "note", f"at {device.port}, without its package", install("devices"))
        elif device.permitted:
            yield Finding(device.name, "ok", f"at {device.port}, for {device.use}")
        else:
            yield Finding(
                device.name, "note", f"at {device.file or device.ids}, not permitted for you",
                "palpate devices --install-udev writes the rule; then plug it in again.",
            )  # fmt: skip
    if not attached:
        cure = "Nothing to do: `port: emulator` and device.Simulated run without one. See `palpate devices`."
        yield Finding("haptic device", "note", "none on USB", cure)


def _libusb() -> Iterator[Finding]:
    """pyusb is a door to a library of the system."""
    import ctypes.util

    if _version("pyusb") is None:
        return
    library = ctypes.util.find_library("usb-1.0")
    yield Finding("libusb", "ok" if library else "note", library or "not on this machine: the Falcon cannot be reached",
                  "" if library else "apt install libusb-1.0-0")  # fmt: skip


def _wake_ups(seconds: float) -> Iterator[Finding]:
    """Whether this machine wakes a process in time for 1 kHz, as any process and with real-time priority."""
    from palpate.launch.machine.lateness import PRIORITY, measure, words

    plain = measure(seconds, None)
    assert plain is not None
    held = plain.p999 < HELD
    cure = "" if held else "Real-time priority (SCHED_RR above) removes most of it; so does an idle machine."
    yield Finding("wake-ups", "ok" if held else "note", words(plain), cure)
    first = measure(seconds, PRIORITY)
    if first is None:
        return
    held = first.p999 < HELD
    cure = "" if held else TUNING
    yield Finding("wake-ups, SCHED_RR", "ok" if held else "note", words(first), cure)
