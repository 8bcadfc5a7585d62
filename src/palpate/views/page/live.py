"""Frames of a running graph for the page."""

import os
import threading
import time

from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.wire.discover import Running
from palpate.nodes.base.effect import effects
from palpate.views.page.explain import explain_plan
from palpate.views.page.feed import FrameSource, StreamReader, mesh_frame
from palpate.views.page.steered import Touched, watched_part

ENDING = 15.0  # [s] timeout of a graceful shutdown
NICE = 10  # niceness of the thread that makes frames, so that the nodes of the run have priority


class Live(FrameSource):
    """The newest frame of a run, made in a separate thread.

    touched   the shown part of the graph
    stopping  set to end the run
    """

    status: str = "starting"

    def __init__(self, touched: Touched) -> None:
        super().__init__()
        self.touched = touched
        self.stopping, self._over = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def on_update(self, launcher: Launcher) -> None:
        """Callback of the launcher: start the thread at the beginning of the run; end the run if `stopping` is set."""
        if self.stopping.is_set():
            launcher.stop()
        elif self._thread is None and launcher.phase == "running":
            self.show_begin()
            self._over.clear()
            self._thread = threading.Thread(target=self._follow, args=(launcher.running,), name="frames", daemon=True)
            self._thread.start()
            self.say("running")

    def show_begin(self) -> None:
        """Called when the run has begun."""

    def over(self) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def say(self, status: str) -> None:
        self.status = status
        self.on_news()

    def _follow(self, run: Running) -> None:
        if hasattr(os, "setpriority"):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        feed, due, last = StreamReader(run, self.touched), time.monotonic(), False
        try:
            while not last:
                last = self._over.is_set()
                frame = feed.frame()
                if frame is not None:
                    self.frame = frame
                    self.on_news()
                due = max(due + 1.0 / self.rate, time.monotonic())
                self._over.wait(due - time.monotonic())
        finally:
            feed.close()


class LiveView(Live):
    """The view of a run that the page does not steer. PageError: the graph cannot be shown."""

    def __init__(self, planned: Plan) -> None:
        super().__init__(watched_part(planned))
        self.mesh = mesh_frame(
            self.touched, {"watch": True, "bodies": [], "effects": {}, "plan": explain_plan(planned)}
        )
        self.status = "the run is starting"

    def over(self) -> None:
        super().over()
        self.say("the run has ended")


def watchable(launch: LaunchFile) -> LaunchFile:
    """The run with the shape of the body computed even if no node reads it, and on the simulated clock with the pace of
    real time, because a faster run would end before it can be seen."""
    can = {effect.name for spec in launch.load().nodes.values() for effect in effects(spec.cls)}
    shape = ["effects.shape=on"] if "shape" in can else []
    return launch.but(overrides=shape, pace=1.0 if launch.clock != "real" and launch.pace is None else None)
