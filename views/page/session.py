"""The run behind the page: a process of its own, started anew for another body or a reset, and its recordings."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import yaml

from palpate.launch.load.launchfile import SOURCES, LaunchFile
from palpate.launch.run.descendants import die_with_parent
from palpate.launch.run.discover import running
from palpate.messages import ForceBand, Friction
from palpate.nodes.base.effect import effects
from palpate.physics.errors import PalpateError
from palpate.views.page.feed import Feed, mesh_frame
from palpate.views.page.steered import BODIES, Touched, steered, touched

FRAMES = 30.0  # [1/s] at most
PATIENCE = 60.0  # [s] for a run to begin: the first one on a machine compiles
ENDING = 10.0  # [s] for a run to end in order


class Session:
    """Keeps one run alive and the newest frame of it; a thread of its own makes the frames.

    launch  the graph as asked for
    folder  for recordings
    sets    single values as after `--set`

    `told` is called from that thread whenever `frame`, `mesh` or `status` is new. NoTouch, GraphError: what is wrong
    with the graph.
    """

    def __init__(self, launch: LaunchFile, folder: Path, sets: list[str]) -> None:
        self.place = tempfile.TemporaryDirectory(prefix="palpate-touch-")
        self.launch, self.socket = steered(launch, Path(self.place.name))
        self.folder, self.sets = folder, sets
        self.touched: Touched = touched(self.launch.but(overrides=sets).plan())
        self.effects = self._effects()
        """The effects that the page may switch, and whether they are on."""
        self.keep = True
        self.kept: list[Path] = []
        self.mesh = self.frame = b""
        self.number = 0
        self.status = "starting"
        self.told: Callable[[], object] = lambda: None
        self._wish = self.touched.use
        self._switched: dict[str, bool] = {}
        self._ended = threading.Event()
        self._change = threading.Event()
        self._outlet = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._outlet.setblocking(False)
        self._thread = threading.Thread(target=self._live, name="page", daemon=True)

    def start(self) -> None:
        """Begin the first run."""
        self._thread.start()

    def point(self, number: int, place: tuple[float, float, float], buttons: int) -> None:
        """Hand a sample of the pointer on; while no run is there it is lost."""
        with contextlib.suppress(OSError):
            self._outlet.sendto(msgspec.msgpack.encode([number, place, buttons]), str(self.socket))

    def lift(self) -> None:
        """The hand goes back to where it began: nobody steers any more."""
        self.point(0, self.touched.begin, 0)

    def begin_again(self, body: str | None = None, effect: tuple[str, bool] | None = None) -> None:
        """End the run and start one with this body, or the same, and this effect on or off. NoBody: no such one."""
        if body is not None and body not in BODIES:
            raise NoBody(f"body: found {body!r}, expected one of {', '.join(BODIES)}")
        if effect is not None and effect[0] not in self.effects:
            raise NoBody(f"effect: found {effect[0]!r}, expected one of {', '.join(self.effects) or 'none'}")
        if effect is not None:
            self.effects[effect[0]] = effect[1]
            self._switched[effect[0]] = effect[1]
        self._wish = body or self.touched.use
        self._change.set()

    def _effects(self) -> dict[str, bool]:
        nodes, shown = self.launch.but(overrides=self.sets).load().nodes.values(), self.touched.streams
        can = {effect.name for spec in nodes for effect in effects(spec.cls)}
        on = {"friction": Friction in shown, "relaxation": True, "band": ForceBand in shown}
        return {name: is_on for name, is_on in on.items() if name in can}

    def close(self) -> None:
        """End the run, its recording being closed in order."""
        self._ended.set()
        self._change.set()
        self._thread.join(ENDING + 5.0)
        self._outlet.close()
        self.place.cleanup()

    # -- the thread ----------------------------------------------------------------------------------------------

    def _live(self) -> None:
        while not self._ended.is_set():
            self._change.clear()
            try:
                self._one_run()
            except (PalpateError, OSError) as error:
                self._say(f"stopped: {error}")
                self._change.wait()

    def _one_run(self) -> None:
        switched = [f"effects.{name}={'on' if on else 'off'}" for name, on in self._switched.items()]
        sets = [*self.sets, *switched, f"{self.touched.body}.use={self._wish}"]
        if self._wish != self.touched.use or switched:
            self.touched = touched(self.launch.but(overrides=sets).plan())
        self._say("starting")
        self.number += 1
        record = self.folder / f"{self.launch.graph.stem}-{self.number}.mcap"
        with subprocess.Popen(self._command(record, sets), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                              stderr=subprocess.PIPE, text=True, preexec_fn=_last_no_longer) as process:  # fmt: skip
            feed = None
            try:
                feed = self._feed(process)
                if feed is not None:
                    self.mesh = mesh_frame(self.touched, {
                        "recording": str(record), "bodies": BODIES, "effects": self.effects,
                    })  # fmt: skip
                    self._say("running")
                    self._follow(process, feed)
            finally:
                if feed is not None:
                    feed.close()
                said = _end(process)
        if self.keep and record.exists():
            self.kept.append(record)
        else:
            record.unlink(missing_ok=True)
        if not self._change.is_set():
            self._say(f"stopped: the run has ended (exit code {process.returncode}). {said.strip()}"[:600])
            self._change.wait()

    def _command(self, record: Path, sets: list[str]) -> list[str]:
        place = Path(self.place.name) / "place.yaml"
        place.write_text(yaml.safe_dump(self.touched.place))
        command = [sys.executable, "-m", "palpate.launch", "run", str(self.launch.graph), "--clock", "real", "-q",
                   "--no-pictures", "--place", str(place), "--record", str(record)]  # fmt: skip
        command += ["--record-only", SOURCES]
        for text in (*self.launch.overrides, *sets):
            command += ["--set", str(text)]
        return command

    def _feed(self, process: subprocess.Popen[str]) -> Feed | None:
        """Listen to the run as soon as all its groups are there; None: it has ended, or something else is wanted."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and process.poll() is None and not self._change.is_set():
            mine = [run for run in running() if run.name.startswith(f"{process.pid}-")]
            if mine and self.touched.place.keys() <= set(mine[0].groups):
                return Feed(mine[0], self.touched)
            self._change.wait(0.1)
        return None

    def _follow(self, process: subprocess.Popen[str], feed: Feed) -> None:
        period, due = 1.0 / FRAMES, time.monotonic()
        while process.poll() is None and not self._change.is_set():
            frame = feed.frame()
            if frame is not None:
                self.frame = frame
                self.told()
            due = max(due + period, time.monotonic())
            self._change.wait(max(due - time.monotonic(), 0.0))

    def _say(self, status: str) -> None:
        self.status = status
        self.told()


class NoBody(PalpateError, ValueError):
    """A body that the page does not offer."""


def _last_no_longer() -> None:
    """A run ends with the page's process, even where that is killed."""
    die_with_parent(signal.SIGTERM)


def _end(process: subprocess.Popen[str]) -> str:
    """End a run in order; what it has said on standard error."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=ENDING)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[1]
