"""Random faults in runs of `palpate run`, and the conditions that each run must fulfil.

python tests/support/random_faults.py SEED [COUNT]      draws and runs them again, one line each
"""

import contextlib
import json
import math
import os
import pty
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

SUPPORT = Path(__file__).parent
sys.path.insert(0, str(SUPPORT))

from graphs_for_runs import GRAPH, write_graph, write_place  # noqa: E402
from unlucky import BEARABLE, BREAKS, WIRES  # noqa: E402
from warm_fork_server import palpate, started_in  # noqa: E402

from palpate.launch.run.descendants import die_with_parent  # noqa: E402
from palpate.records.reader import Recording  # noqa: E402
from palpate.records.stored import RecordingError  # noqa: E402

SIGNALS = ("SIGKILL", "SIGTERM", "SIGSEGV", "SIGSTOP", "SIGINT", "SIGABRT", "SIGHUP")
LONGEST = 150.0
"""[s] after which a run counts as hung; longer than the timeout of a node's start."""
RUN = 2.0
"""[s] of the graph's clock: all faults on the real clock, and faults of steps on both, occur before its end."""
LIMITED, FUSED, APART = 9.0, 40.0, 20.0
"""[s] on the simulated clock for faults at a wall time or a limit. Simulated time runs at most 27 times as fast as real
time in one process, and 13 times in several, so no run ends before its fault."""


NOT_FUSED = ("stops itself", "exits", "forks", "starts a program")
"""Faults of a node that concern its whole process: a stopped run waits, an exit ends it, and children belong to the
user."""
HARMLESS = ("sends a frame twice", "steps the clock")
NO_HANG = (*HARMLESS, "garbles a frame")
"""Faults during which a process that is not scheduled for 1 s must not count as hung: the run continues, or ends with
another error."""


class Fault(NamedTuple):
    """A fault, its place and time.

    kind    "node": a node does `what`; "wire": the connection of its messages does; "signal": a process gets `what`;
    "limit": the system refuses `what`; "terminal": the terminal closes; "busy": other programs use the processors whom
    target of a signal: "launcher", "fork server", or "one", a process below the launcher with index `moment` moment
    [s] after the first sign of the run, or [1] steps of the node"""

    kind: str
    what: str
    whom: str
    clock: str
    placement: str
    graph: str
    moment: float


def draw(seed: int) -> Fault:
    """The fault of this seed."""
    rng = random.Random(seed)
    clock = rng.choice(("simulated", "real"))
    placement, graph = rng.choice(("each", "groups", "fused")), rng.choice(("loop", "loop", "loop", "kidney"))
    kind = rng.choices(("node", "signal", "limit", "terminal", "wire", "busy"), (10, 9, 3, 1, 4, 1))[0]
    if kind == "wire":
        placement = "each" if placement == "fused" else placement  # a fused run has no connections
        return Fault(kind, rng.choice(sorted(WIRES)), "spring", clock, placement, "loop", rng.randint(20, 200))
    if kind == "node":
        how = rng.choice(sorted(BREAKS | BEARABLE))
        if how in NOT_FUSED and placement == "fused":
            placement = "each"
        return Fault(kind, how, "spring", clock, placement, "loop", rng.randint(20, 200))
    if kind == "signal":
        whom = rng.choice(("launcher", "fork server", "one", "one", "one"))
        name = rng.choice(SIGNALS[:5] if whom == "launcher" else SIGNALS)
        name = "SIGTERM" if whom in ("launcher", "fork server") and name == "SIGSTOP" else name  # a stopped run waits
        return Fault(kind, name, whom, clock, placement, graph, rng.uniform(0.0, 1.5))
    if kind == "limit":
        what = rng.choice(("file size", "descriptors", "disk"))
        what = what if what != "disk" or has_small_disks() else "file size"
        return Fault(kind, what, "", clock, placement, graph, rng.uniform(0.0, 1.0))
    if kind == "busy":
        return Fault(kind, "4 loops", "", clock, placement, graph, 0.0)
    return Fault(kind, "closed", "", clock, placement, graph, rng.uniform(0.0, 1.5))


def _length(fault: Fault) -> float:
    """[s] of the graph's clock."""
    nobody = fault.placement == "fused" and fault.whom not in ("", "launcher")  # a fused run has no child processes
    if fault.clock == "real" or nobody or fault.kind not in ("limit", "signal", "terminal"):
        return RUN
    if fault.kind == "limit":
        return LIMITED
    return FUSED if fault.placement == "fused" else APART


def run(fault: Fault, folder: Path) -> list[str]:
    """Run a fault; returns the violated conditions."""
    patience = "5" if fault.kind == "busy" or fault.what in NO_HANG else "1"
    mark, own = uuid.uuid4().hex, folder / "own"
    own.mkdir()
    file = folder / "run.mcap"
    kept = file
    if fault.what == "disk":
        (folder / "disk").mkdir()
        file = folder / "disk" / "run.mcap"
    arguments = ["run", *_graph(fault, folder), "--record", str(file), "--clock", fault.clock, "--no-pictures",
                 "--timeout", patience, "--duration", str(_length(fault))]  # fmt: skip
    on_small_disk = [*_small_disk(fault, folder / "disk", kept), sys.executable, "-m", "palpate.cli", *arguments]
    environment = os.environ | {"PALPATE_FAULT": mark, "PYTHONPATH": f"{SUPPORT}:{os.environ.get('PYTHONPATH', '')}",
                                "XDG_RUNTIME_DIR": str(own), "TMPDIR": str(own), "COLUMNS": "200"}  # fmt: skip
    master, slave = pty.openpty() if fault.kind == "terminal" else (None, None)
    reported = folder / "output"
    with reported.open("wb") as out:
        given: dict[str, Any] = {
            "cwd": folder, "env": environment, "start_new_session": True, "preexec_fn": _limits(fault),
            "stdin": slave if slave is not None else subprocess.DEVNULL, "stdout": slave or out, "stderr": slave or out,
        }  # fmt: skip
        child = subprocess.Popen(on_small_disk, **given) if fault.what == "disk" else palpate(arguments, **given)
    if master is not None:
        threading.Thread(target=_drain, args=(master,), daemon=True).start()
    with _company(4 if fault.kind == "busy" else 0):
        hit = _strike(fault, child, file, master)
        if slave is not None:
            os.close(slave)
        try:
            code = child.wait(LONGEST)
        except subprocess.TimeoutExpired:
            _sweep(folder, mark)
            child.wait()
            return [f"did not end within {LONGEST:g} s: {reported.read_text(errors='replace')[-500:]}"]
    return _judge(fault, code, hit, reported.read_text(errors="replace"), kept, mark, own)


@contextlib.contextmanager
def _company(count: int) -> Iterator[None]:
    """Run this number of programs that each use a whole processor."""
    loop = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(loop, preexec_fn=die_with_parent) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def _small_disk(fault: Fault, place: Path, kept: Path) -> list[str]:
    """A command prefix that mounts a file system of 60 to 460 kB at `place`, and copies the recording at the end."""
    script = 'mount -t tmpfs -o size=$1k tmpfs "$2" || exit 99; disk=$2 kept=$3; shift 3; "$@"; code=$?'
    script += '; cp "$disk/run.mcap" "$kept"; exit $code'
    return ["unshare", "-rm", "sh", "-c", script, "sh", str(60 + int(400 * fault.moment)), str(place), str(kept)]


@cache
def has_small_disks() -> bool:
    """Whether this system permits users to mount a file system."""
    if shutil.which("unshare") is None:
        return False
    with tempfile.TemporaryDirectory() as place:
        mount = ["unshare", "-rm", "mount", "-t", "tmpfs", "-o", "size=60k", "tmpfs", place]
        return subprocess.run(mount, capture_output=True).returncode == 0


def _drain(master: int) -> None:
    """Read the output of a terminal, because a full one blocks its writers."""
    with contextlib.suppress(OSError):
        while os.read(master, 65536):
            pass


def _graph(fault: Fault, folder: Path) -> list[str]:
    """Arguments of `palpate run` for the graph and its placement."""
    if fault.graph == "kidney":
        graph, groups = ["kidney", "--set", "scene.surface.vertices=1000"], [["device", "finger", "collision"]]
    else:
        how = f'unlucky.Unlucky, how: "{fault.what}", at: {int(fault.moment)},'
        text = GRAPH.replace("nodes_for_runs.Spring,", how) if fault.kind in ("node", "wire") else GRAPH
        graph, groups = [str(write_graph(folder, text))], [["source", "drag"], ["spring"], ["spread", "sum"]]
    if fault.placement == "groups":
        return [*graph, "--place", str(write_place(folder, groups))]
    return [*graph, "--fused"] if fault.placement == "fused" else graph


def _limits(fault: Fault):  # type: ignore[no-untyped-def]
    """The limits that the system sets for the run."""
    if fault.kind != "limit" or fault.what == "disk":
        return None
    if fault.what == "descriptors":
        return lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (24 + int(200 * fault.moment),) * 2)
    size = 2000 + int(200_000 * fault.moment)
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def _strike(fault: Fault, child: subprocess.Popen[bytes], file: Path, master: int | None) -> bool:
    """Wait for the moment and cause the fault; returns whether it reached a process."""
    if fault.kind in ("node", "limit", "wire", "busy"):
        return True
    until = time.monotonic() + 60.0
    while child.poll() is None and time.monotonic() < until and not file.exists():
        time.sleep(0.01)
    time.sleep(fault.moment)
    if fault.kind == "terminal":
        assert master is not None
        os.close(master)
        return child.poll() is None
    under = below(child.pid)
    pid = child.pid
    if fault.whom == "fork server":
        pid = under[0] if under else 0
    elif fault.whom == "one":
        under = under[1:] or under  # stopping the fork server would block the run
        pid = under[int(1000 * fault.moment) % len(under)] if under else 0
    if not pid or child.poll() is not None:
        return False
    try:
        os.kill(pid, getattr(signal, fault.what))
    except ProcessLookupError:
        return False
    return True


def below(pid: int) -> list[int]:
    """Processes below one, parents first."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            parents.setdefault(int(fields[1]), []).append(int(entry.name))
    todo, below = [pid], []
    while todo:
        own = sorted(parents.get(todo.pop(0), []))
        below += own
        todo += own
    return below


def _sweep(folder: Path, mark: str) -> None:
    for pid in started_in(folder, mark):
        os.kill(pid, signal.SIGKILL)


def _judge(fault: Fault, code: int, hit: bool, reported: str, file: Path, mark: str, own: Path) -> list[str]:
    wrong = []
    until = time.monotonic() + 60.0  # a killed process may wait for a processor
    while (left := started_in(own.parent, mark)) and time.monotonic() < until:
        time.sleep(0.05)
    if left:
        wrong.append(f"{len(left)} processes are left")
        _sweep(own.parent, mark)
    lost = fault.kind == "wire" and WIRES[fault.what] and fault.clock == "simulated"
    breaks = hit and (fault.kind == "signal" or (fault.kind == "node" and fault.what in BREAKS) or lost)
    finished = "ticks in" in reported  # the signal arrived at the end of the run
    if breaks and code == 0 and not finished:
        wrong.append("the exit code is 0")
    if code and (fault.kind == "busy" or fault.what in HARMLESS):
        wrong.append("it ended by a harmless fault")
    if "Traceback" in reported and "unlucky.py" not in reported:  # a traceback of a node's code is intended
        wrong.append("a traceback")
    mute = fault.placement == "fused" and fault.what in ("kills itself", "crashes")  # the reporting process was killed
    if (lost or (fault.kind == "node" and fault.what in BREAKS)) and "spring" not in reported and not mute:
        wrong.append("the failed node is not named")
    if code > 0 and not reported.strip() and fault.kind != "terminal":
        wrong.append(f"exit code {code} without a message")
    if len(reported) > 20_000 and fault.what != "prints without end":
        wrong.append(f"{len(reported)} characters were printed")
    if file.exists() and file.stat().st_size:
        wrong += _recorded(fault, file)
    hard = fault.kind == "signal" and fault.whom != "one"  # a killed process cannot clean up
    if not hard and (more := sorted(path.name for path in own.rglob("*") if not path.is_dir())):
        wrong.append(f"left over: {', '.join(more[:3])}")
    if not wrong:
        return []
    trace = reported.find("Traceback")
    return [*wrong, f"code {code}: {reported[trace : trace + 3000] if trace >= 0 else reported[-700:]}"]


def _recorded(fault: Fault, file: Path) -> list[str]:
    """Faults of the recording up to the failure."""
    torque = "statics" if fault.graph == "kidney" else "sum"
    try:
        recording = Recording(file)
        if torque in recording.streams:
            for message in recording.messages(torque):
                if not all(map(math.isfinite, message.torques)):
                    return [f"tick {message.tick}: torque {message.torques}"]
        if fault.graph == "kidney" and "controller" in recording.streams:
            for message in recording.messages("controller"):
                if not math.hypot(*message.force) <= 9.0 + 1e-9:
                    return [f"tick {message.tick}: force {message.force}"]
    except RecordingError as error:
        return [] if "before its first message" in str(error) else [f"the recording: {error}"]
    return []


def main() -> None:
    seed, count = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for own in range(seed, seed + count):
        with tempfile.TemporaryDirectory() as folder:
            fault, begun = draw(own), time.monotonic()
            wrong = run(fault, Path(folder))
            print(json.dumps([own, round(time.monotonic() - begun, 1), fault._asdict(), wrong]), flush=True)


if __name__ == "__main__":
    main()
