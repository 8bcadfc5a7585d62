"""Faults between the processes of a run on the real clock, at rates at which compiled code reads the sockets.

A relay takes the place of an outlet: it renames the outlet's socket and listens at its path. The frames of one stream
pass through it and are lost, repeated, reordered, delayed, damaged or cut; readers and nodes stop and end.

    python tests/support/bad_wires.py SEED [COUNT]      runs these faults again, one line each
"""

import contextlib
import json
import math
import os
import random
import selectors
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.engine.provenance import about
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import Ready
from palpate.launch.run.wire.zmtp import GREETING, Decoder, command, frame, ready
from palpate.records.reader import Recording
from palpate.records.replay import Replay

EDGES = ("device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics")
"""Senders of the streams of the same names."""
RECORDED = ("device", "finger", "contact", "statics")
RATES = (5000.0, 10_000.0)
LASTS = 0.8  # [s]
OVER = 1.2  # [1] limit of the contact force over that of the same motion without faults
GONE = 0.020  # [s] after a death until the device has no torque
LONGEST = 60.0  # [s] after which a run counts as hung
TOUCH = (
    "scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.105]",
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.2}, {hold: 0.15},"
    "{to: [0.01, 0, 0.0935], time: 0.15, shape: linear}, {hold: 1}]",
)  # fmt: skip
NODES = ("kill", "stop", "pause")
WIRES = ("lose", "outage", "repeat", "reorder", "delay", "garbage", "cut", "http", "half", "stuck", "deaf")


class Fault(NamedTuple):
    """A fault: its kind, the node or the sender of the stream, its rate [Hz], begin and length [s], and a share [1]."""

    kind: str
    where: str
    rate: float
    begin: float
    length: float
    share: float


def draw(seed: int) -> Fault:
    """The fault of this seed."""
    rng = random.Random(seed)
    kind = rng.choice((*NODES, *WIRES, *WIRES))
    where = rng.choice(EDGES[1:] if kind in NODES else EDGES)
    length = rng.choice((0.005, 0.02, 0.06, 0.2))
    share = rng.uniform(0.7, 0.9) if kind == "lose" else rng.choice((0.02, 0.2, 1.0))
    return Fault(kind, where, rng.choice(RATES), rng.uniform(0.1, 0.5), length, share)


class Relay:
    """Takes the place of the outlet at `path`, and passes its frames on. `fault` is active while `on()` is true."""

    def __init__(self, path: str, fault: Fault, on: Callable[[], bool]) -> None:
        self._fault, self._on, self._rng = fault, on, random.Random(1)
        self._real = f"{path}.r"
        os.rename(path, self._real)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(path)
        self._listener.listen(64)
        self._select = selectors.DefaultSelector()
        self._select.register(self._listener, selectors.EVENT_READ, None)
        self._late: list[tuple[float, socket.socket, bytes]] = []
        self._kept: list[bytes] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for key in list(self._select.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]

    def _pass_on(self) -> None:
        while not self._ended.is_set():
            for key, _ in self._select.select(0.002):
                if key.data is None:
                    self._accept()
                elif key.data[0] == "up":
                    self._copy(key.fileobj, key.data[1])  # type: ignore[arg-type]
                elif not (self._fault.kind == "stuck" and self._on()):
                    self._spoil(key.fileobj, *key.data[1:])  # type: ignore[arg-type]
            for each in [each for each in self._late if each[0] <= time.monotonic()]:
                self._late.remove(each)
                self._send(*each[1:])

    def _accept(self) -> None:
        near, _ = self._listener.accept()
        far = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            far.connect(self._real)
        except OSError:
            near.close()
            return
        self._select.register(near, selectors.EVENT_READ, ("up", far))
        self._select.register(far, selectors.EVENT_READ, ("down", near, Decoder(1 << 28), bytearray()))

    def _copy(self, near: socket.socket, far: socket.socket) -> None:
        try:
            data = near.recv(65536)
        except OSError:
            data = b""
        if data:
            self._send(far, data)
        else:
            self._drop(near, far)

    def _drop(self, *ends: socket.socket) -> None:
        for end in ends:
            with contextlib.suppress(KeyError, ValueError):
                self._select.unregister(end)
            end.close()

    def _send(self, end: socket.socket, data: bytes) -> None:
        with contextlib.suppress(OSError):
            end.settimeout(1.0)
            end.sendall(data)

    def _spoil(self, far: socket.socket, near: socket.socket, decoder: Decoder, greeted: bytearray) -> None:
        try:
            data = far.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._drop(far, near)
            return
        if len(greeted) < len(GREETING):
            part = data[: len(GREETING) - len(greeted)]
            greeted += part
            self._send(near, part)
            data = data[len(part) :]
        for flags, body in decoder.feed(data):
            data, whole = frame(body, flags), flags == 0
            if not (whole and self._on()):
                self._send(near, b"".join((*self._kept, data)))
                self._kept.clear()
            elif self._fault.kind in ("cut", "http", "half"):
                begun = {"cut": b"", "http": b"HTTP/1.1 200 OK\r\n\r\n", "half": data[: len(data) // 2]}
                self._send(near, begun[self._fault.kind])
                self._drop(far, near)
                return
            else:
                self._spoil_frame(near, data)

    def _spoil_frame(self, near: socket.socket, data: bytes) -> None:
        hit, kind = self._rng.random() < self._fault.share, self._fault.kind
        if kind == "outage" or (kind == "lose" and hit):
            return
        if kind == "delay" and hit:
            self._late.append((time.monotonic() + self._rng.uniform(0.0, 0.03), near, data))
            return
        if kind == "reorder" and hit:
            self._kept.append(data)
            if len(self._kept) > 3:
                self._rng.shuffle(self._kept)
                self._send(near, b"".join(self._kept))
                self._kept.clear()
            return
        if kind == "repeat" and hit:
            data += data
        if kind == "garbage" and hit:
            topic = data[2 : data.index(b"\0", 2) + 1]
            body = data[2 + len(topic) :]
            damaged = (body[: self._rng.randrange(len(body))], self._rng.randbytes(60), b"", b"\xc1" + body)
            data = frame(topic + self._rng.choice(damaged)) + (data if self._rng.random() < 0.5 else b"")
        self._send(near, data)


class SpoiledRun(Launcher):
    """A run with a fault."""

    def __init__(self, fault: Fault, work: list) -> None:
        self.fault, self.struck = fault, 0.0
        self.relay: Relay | None = None
        self._deaf: socket.socket | None = None
        super().__init__(work, patience=3.0, show=self._look)
        self._timer = threading.Thread(target=self._strike, daemon=True)
        self._timer.start()

    def active(self) -> bool:
        """Whether the fault lasts."""
        begin = self.origin * 1e-9 + self.fault.begin
        return bool(self.origin) and begin <= time.monotonic() < begin + self.fault.length

    def _ready(self, member: WorkerHandle, report: Ready) -> None:
        if member.job.group == self.fault.where and self.relay is None:
            path = report.endpoints["force"][0].removeprefix("ipc://")
            if self.fault.kind in WIRES[:-1]:
                self.relay = Relay(path, self.fault, self.active)
            elif self.fault.kind == "deaf":
                self._deaf = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._deaf.connect(path)
                hello = GREETING + ready({b"Socket-Type": b"SUB"}) + command(b"SUBSCRIBE", self.fault.where.encode())
                self._deaf.sendall(hello)
        super()._ready(member, report)

    def _look(self, _: Launcher) -> None:
        if time.monotonic() - self.begun > LONGEST:
            raise TimeoutError(f"{self.fault}: the run does not end")

    def _strike(self) -> None:
        """Send the signals of a fault of a node."""
        while not self.origin and self.phase != "ended":
            time.sleep(0.002)
        if self.fault.kind not in NODES:
            return
        time.sleep(max(0.0, self.origin * 1e-9 + self.fault.begin - time.monotonic()))
        pid = self.pids.get(self.fault.where)
        if pid is None:
            return
        begun = time.monotonic()
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL if self.fault.kind == "kill" else signal.SIGSTOP)
            sent = time.monotonic()
            self.struck = sent if sent - begun < 0.001 else 0.0  # otherwise its moment is not known
            if self.fault.kind == "pause":
                time.sleep(self.fault.length)
                os.kill(pid, signal.SIGCONT)

    def close(self) -> None:
        if self.relay is not None:
            self.relay.close()
        if self._deaf is not None:
            self._deaf.close()
        self._timer.join()


def loudest(recording: Recording) -> float:
    """Largest contact force [N]."""
    return max((message.force for message in recording.messages("contact")), default=0.0)


def undisturbed(rate: float, folder: Path) -> float:
    """Largest contact force [N] without faults."""
    file = folder / "undisturbed.mcap"
    execute(find("kidney").but(place="fused", duration=LASTS, record=file, overrides=(f"rate={rate}", *TOUCH)))
    return loudest(Recording(file))


def run(fault: Fault, folder: Path, base: float) -> list[str]:
    """Run a fault; returns the violated conditions. base [N]: see `undisturbed`"""
    file = folder / "run.mcap"
    graph = find("kidney").but(record=file, overrides=(f"rate={fault.rate}", *TOUCH)).load()
    set_recording(graph, file, [name for name in EDGES if name not in RECORDED])
    steps = plan(graph)
    placed = find("kidney").but(place="apart").placement(steps)
    work = jobs(steps, placed, clock="real", ticks=round(LASTS * fault.rate), about=about(steps))
    launcher = SpoiledRun(fault, work)
    try:
        result = launcher.run()
    except TimeoutError as error:
        return [str(error)]
    finally:
        launcher.close()
    wrong = []
    if fault.kind in ("kill", "stop"):
        if not result.deaths or result.deaths[0].node != fault.where:
            wrong.append(f"deaths: {result.deaths}")
    elif result.deaths:
        wrong.append(f"it ended: {result.deaths}")
    recording = Recording(file)
    for name in RECORDED:
        counted, steps_made = recording.counts.get(name, {}), result.health[name]["steps"]
        if not result.deaths and counted["count"] + counted["lost"] != steps_made:
            wrong.append(f"{name}: {steps_made} steps, {counted}")
    if any(recording.counts.get(name, {}).get("lost") for name in RECORDED):
        return wrong  # the logger of a busy machine: forces and torques are not all known
    force = loudest(recording)
    if not force <= OVER * base:
        same = _without_fault(recording, steps, folder)
        if not force <= OVER * same:
            wrong.append(f"contact {force:.2f} N, {same:.2f} N without the fault")
    if fault.kind in ("kill", "stop") and fault.where != "friction" and launcher.struck:  # it is optional
        torque = {message.tick: any(message.torques) for message in recording.messages("statics")}
        begun = launcher.struck - launcher.origin * 1e-9
        late = [
            message.time * 1e-9 - begun for message in recording.messages("device")
            if message.used != (-1,) and torque.get(message.used[0], True) and message.time * 1e-9 > begun + GONE
        ]  # fmt: skip
        if late:
            wrong.append(f"torque until {max(late):.3f} s after the fault")
    return wrong


def _without_fault(recording: Recording, steps, folder: Path) -> float:  # type: ignore[no-untyped-def]
    """Largest contact force [N] of the recorded poses."""
    file = folder / "same.mcap"
    file.unlink(missing_ok=True)
    Replay(recording, steps, only=("collision", "contact", "friction", "spread", "tissue"), out=file).run()
    return loudest(Recording(file))


def main() -> None:
    seed, count = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    with tempfile.TemporaryDirectory() as folder:
        base = {rate: undisturbed(rate, Path(folder)) for rate in RATES}
        for own in range(seed, seed + count):
            fault, begun = draw(own), time.monotonic()
            wrong = run(fault, Path(folder), base[fault.rate])
            print(json.dumps([own, round(time.monotonic() - begun, 1), fault._asdict(), wrong]), flush=True)
            if not math.isfinite(base[fault.rate]):
                raise SystemExit("the undisturbed run has no force")


if __name__ == "__main__":
    main()
