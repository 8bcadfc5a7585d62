"""A run that goes on: its newest frame. The run itself says when it has begun, and where it can be heard."""

import os
import threading
import time

from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.wire.discover import Running
from palpate.nodes.base.effect import effects
from palpate.views.page.feed import StreamReader, mesh_frame
from palpate.views.page.source import FrameSource
from palpate.views.page.steered import Touched, watched

ENDING = 15.0  # [s] for a run to end in order
BEHIND = 10  # By which what makes the frames stands behind the nodes of a run for a processor


class Live(FrameSource):
    """The newest frame of a run; a thread of its own makes the frames.

    touched   what is shown of it
    stopping  set where the run is to end
    """

    status: str = "starting"

    def __init__(self, touched: Touched) -> None:
        super().__init__()
        self.touched = touched
        self.stopping, self._over = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def on_update(self, launcher: Launcher) -> None:
        """Called by the launcher again and again: follow its run from its beginning."""
        if self.stopping.is_set():
            launcher.stop()
        elif self._thread is None and launcher.phase == "running":
            self.begun()
            run = Running(launcher.run_id, [group for group, job in launcher.jobs.items() if job.nodes])
            self._over.clear()
            self._thread = threading.Thread(target=self._follow, args=(run,), name="frames", daemon=True)
            self._thread.start()
            self.say("running")

    def begun(self) -> None:
        """The run has begun."""

    def over(self) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def say(self, status: str) -> None:
        self.status = status
        self.on_news()

    def _follow(self, run: Running) -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), BEHIND)
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
    """A run for those who look and do not touch. PageError: what the graph lacks to be shown."""

    def __init__(self, planned: Plan) -> None:
        super().__init__(watched(planned))
        self.mesh = mesh_frame(self.touched, {"watch": True, "bodies": [], "effects": {}})
        self.status = "the run is starting"

    def over(self) -> None:
        super().over()
        self.say("the run has ended")


def watchable(launch: LaunchFile) -> LaunchFile:
    """The run with the shape of its body computed, though no node of it may read that; at the pace of the world, as
    one that is faster is over before it is seen."""
    can = {effect.name for spec in launch.load().nodes.values() for effect in effects(spec.cls)}
    shape = ["effects.shape=on"] if "shape" in can else []
    return launch.but(overrides=shape, pace=1.0 if launch.clock != "real" and launch.pace is None else None)
