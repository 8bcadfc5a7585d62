"""Diagnostics of this machine, with a remedy for each missing function."""

import ctypes
import ctypes.util
import importlib.metadata
import importlib.util
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.compiler.cores import usable_cores
from palpate.physics.extras import EXTRAS, install, package_version

TUNING = (
    "Set the CPU governor to performance (cpupower frequency-set -g performance), keep a core free (isolcpus, and"
    " `core:` in a placement), switch off deep sleep states; give a virtual machine dedicated cores."
)
ON_TIME = 0.5e-3  # [s] latency of the 99.9 % wake-up up to which the machine can run at 1 kHz
PRIORITY = 60  # of SCHED_RR
PERIOD = 1e-3  # [s]
TIMERSLACK = 29

MESA = "Install Mesa (libosmesa6 or libegl1)."
_PICTURE = (
    "import pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Sphere()); p.screenshot(return_img=True)"
)


@dataclass(frozen=True)
class Diagnostic:
    """The result of one check.

    state  "ok", "note": some functions are not available, "fault": no run is possible
    """

    what: str
    state: str
    found: str
    cure: str = ""


def examine(*, pictures: bool = True, seconds: float = 2.0) -> Iterator[Diagnostic]:
    """Run all checks.

    pictures  draw a test picture, which takes seconds
    seconds   [s] duration of each measurement of wake-ups, without and with real-time priority; 0: no measurement, and
              no start of the usual graphs
    """
    yield Diagnostic("python", "ok", platform.python_version())
    yield _system()
    yield from _packages()
    if seconds > 0.0:
        yield _kernels()
    if pictures:
        yield _pictures()
    if sys.platform != "linux":
        return
    yield _cores()
    yield _fifo()
    yield _memory()
    if seconds > 0.0:
        yield from _wake_ups(seconds)
    yield from _libusb()
    yield from _usb()


def _system() -> Diagnostic:
    if sys.platform == "linux":
        return Diagnostic("system", "ok", "Linux, on which palpate is tested")
    found = f"{platform.system()}, on which palpate is untested; processes of a run are connected by TCP on loopback"
    return Diagnostic("system", "note", found, "palpate echo and palpate top, priority and pinned cores need Linux.")


def _packages() -> Iterator[Diagnostic]:
    for line in importlib.metadata.requires("palpate") or []:
        if "extra ==" in line:
            continue
        name = re.split(r"[\s<>=!~;\[]", line, maxsplit=1)[0]
        version = package_version(name)
        if version and name == "pyzmq":
            import zmq

            version += f", ZeroMQ {zmq.zmq_version()}"
        yield Diagnostic(name, "ok" if version else "fault", version or "not installed",
                         "" if version else f"pip install {name}")  # fmt: skip
    for extra, packages in EXTRAS.items():
        versions = {name: package_version(name) for name in packages}
        lacking = [name for name, version in versions.items() if version is None]
        listing = ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
        yield Diagnostic(f"extra {extra}", "note" if lacking else "ok", listing, install(extra) if lacking else "")


def _kernels() -> Diagnostic:
    """Whether the usual graphs start without a compilation, found in a subprocess that ends at the first one."""
    command = [sys.executable, "-m", "palpate.cli.machine.kernels", "check"]
    code = subprocess.run(command, capture_output=True).returncode
    if code == 0:
        return Diagnostic("kernels", "ok", "compiled for the usual graphs")
    return Diagnostic(
        "kernels", "note", "not compiled: the first run compiles them, 10 to 40 s", "palpate doctor --compile"
    )


def _pictures() -> Diagnostic:
    """Draw a test picture in a subprocess: without a display, some builds of VTK terminate the process."""
    what = "off-screen pictures"
    if importlib.util.find_spec("pyvista") is None:
        return Diagnostic(what, "note", "pyvista is not installed", install("view"))
    try:
        run = subprocess.run([sys.executable, "-c", _PICTURE], capture_output=True, timeout=60)
        why = f"cannot be drawn (exit code {run.returncode})" if run.returncode else ""
    except subprocess.TimeoutExpired:
        why = "no picture within 60 s"
    return Diagnostic(what, "note" if why else "ok", why or "can be drawn", MESA if why else "")


def _cores() -> Diagnostic:
    cores = usable_cores()
    listing = f"{len(cores)} usable: {', '.join(map(str, cores))}"
    few = len(cores) < 2
    return Diagnostic(
        "cores", "note" if few else "ok", listing, "The force path needs a dedicated core." if few else ""
    )


def _fifo() -> Diagnostic:
    """Whether this process may use real-time priority; the previous policy is restored."""
    policy, given = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        cure = "Add `@realtime - rtprio 99` to /etc/security/limits.conf and yourself to that group; log in again."
        return Diagnostic("SCHED_RR", "note", "not permitted: ticks may be late under load", cure)
    os.sched_setscheduler(0, policy, given)
    return Diagnostic("SCHED_RR", "ok", "permitted")


def _memory() -> Diagnostic:
    """Whether this process may lock its memory; it is unlocked again."""
    import resource

    libc = ctypes.CDLL(None, use_errno=True)
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    words = "no limit" if limit == resource.RLIM_INFINITY else f"limit {limit // 1024} kB"
    if libc.mlockall(1) == 0:  # MCL_CURRENT
        libc.munlockall()
        return Diagnostic("locked memory", "ok", f"permitted, {words}")
    cure = "Add `@realtime - memlock unlimited` to /etc/security/limits.conf; log in again."
    return Diagnostic("locked memory", "note", f"not permitted, {words}: page faults may delay a tick", cure)


def _usb() -> Iterator[Diagnostic]:
    from palpate.drivers.discover import devices

    attached = False
    for device in devices():
        attached = True
        if device.missing:
            yield Diagnostic(device.name, "note", f"at {device.port}, without its package", install("devices"))
        elif device.permitted:
            yield Diagnostic(device.name, "ok", f"at {device.port}, for {device.use}")
        else:
            yield Diagnostic(
                device.name, "note", f"at {device.file or device.ids}, not permitted for you",
                "palpate devices --install-udev writes the rule; then plug it in again.",
            )  # fmt: skip
    if not attached:
        cure = "Nothing to do: `port: emulator` and device.Simulated run without one. See `palpate devices`."
        yield Diagnostic("haptic device", "note", "none on USB", cure)


def _libusb() -> Iterator[Diagnostic]:
    """Whether the system library behind pyusb is installed."""
    if package_version("pyusb") is None:
        return
    library = ctypes.util.find_library("usb-1.0")
    yield Diagnostic("libusb", "ok" if library else "note", library or "not installed: the Falcon cannot be used",
                  "" if library else "apt install libusb-1.0-0")  # fmt: skip


def _wake_ups(seconds: float) -> Iterator[Diagnostic]:
    """Wake-up latency at 1 kHz, with normal and with real-time priority."""
    idle = "Real-time priority (SCHED_RR above) removes most of it; so does an idle machine."
    for what, priority, cure in (("wake-ups", None, idle), ("wake-ups, SCHED_RR", PRIORITY, TUNING)):
        if (late := measure(seconds, priority)) is not None:
            kept = late.p999 < ON_TIME
            yield Diagnostic(what, "ok" if kept else "note", words(late), "" if kept else cure)


@dataclass(frozen=True)
class Lateness:
    """Wake-up latency [s]: median, 99 %, 99.9 %, maximum; and the fraction later than a whole period."""

    p50: float
    p99: float
    p999: float
    worst: float
    missed: float


def measure(seconds: float, priority: int | None, period: float = PERIOD) -> Lateness | None:
    """Measure the latency of wake-ups at the end of each period [s]. None: the priority is not permitted.

    priority  of SCHED_RR; None: normal scheduling. The previous policy is restored.
    """
    import numpy as np

    policy, given = os.sched_getscheduler(0), os.sched_getparam(0)
    libc = ctypes.CDLL(None)
    try:
        if priority is not None:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
        libc.prctl(TIMERSLACK, 1)
        count = max(10, round(seconds / period))
        late = np.zeros(count)
        begin = time.monotonic()
        for k in range(count):
            due = begin + (k + 1) * period
            left = due - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            late[k] = time.monotonic() - due
    except PermissionError:
        return None
    finally:
        os.sched_setscheduler(0, policy, given)
    late = np.maximum(late, 0.0)
    p50, p99, p999 = np.percentile(late, (50, 99, 99.9))
    return Lateness(float(p50), float(p99), float(p999), float(late.max()), float(np.mean(late > period)))


def words(lateness: Lateness) -> str:
    parts = [f"{name} {1e3 * value:.3f}" for name, value in (
        ("p50", lateness.p50), ("p99", lateness.p99), ("p99.9", lateness.p999), ("max", lateness.worst))]  # fmt: skip
    return f"{', '.join(parts)} ms late; {100 * lateness.missed:.2f} % miss their millisecond"
