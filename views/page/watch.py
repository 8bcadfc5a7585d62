"""A run that goes on, for those who look and do not touch: its newest frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from palpate.engine.plan import Plan
from palpate.launch.run.discover import Running, running
from palpate.views.page.feed import Feed, mesh_frame
from palpate.views.page.steered import watched

FRAMES = 30.0
"""[1/s] at most."""
LOOK = 0.1
"""[s] between looks for the run, and whether it still goes on."""
TAIL = 0.5
"""[s] of no news after which it is asked whether the run still goes on."""


class Watch:
    """Keeps the newest frame of the run of one launcher; a thread of its own makes the frames.

    planned   what runs
    launcher  process that the run is of
    groups    of nodes, as they are placed

    NoTouch: what the graph lacks to be shown.
    """

    def __init__(self, planned: Plan, launcher: int, groups: set[str]) -> None:
        self.touched = watched(planned)
        self.mesh = mesh_frame(self.touched, {"watch": True, "bodies": [], "effects": {}})
        self.frame = b""
        self.status, self.keep = "the run is starting", False
        self.over = False
        """Whether the run has ended."""
        self.told: Callable[[], object] = lambda: None
        self._launcher, self._groups = launcher, groups
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._live, name="watch", daemon=True)

    def start(self) -> None:
        """Begin to look for the run."""
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._closed.set()
        self._thread.join()

    def _live(self) -> None:
        run = None
        while run is None and not self._closed.wait(LOOK):
            run = self._run()
        if run is None:
            return
        self._say("running")
        feed = Feed(run, self.touched)
        try:
            self._follow(feed, run)
        finally:
            feed.close()
        self.over = True
        self._say("the run has ended")

    def _run(self) -> Running | None:
        """The launcher's run, once all groups with nodes are there."""
        mine = [run for run in running() if run.name.startswith(f"{self._launcher}-")]
        return mine[0] if mine and self._groups <= set(mine[0].groups) else None

    def _follow(self, feed: Feed, run: Running) -> None:
        heard = due = time.monotonic()
        while not self._closed.is_set():
            frame = feed.frame()
            moment = time.monotonic()
            if frame is not None:
                self.frame, heard = frame, moment
                self.told()
            elif moment - heard > TAIL:
                if not any(run.name == other.name for other in running()):
                    return
                heard = moment
            due = max(due + 1.0 / FRAMES, moment)
            self._closed.wait(due - moment)

    def _say(self, status: str) -> None:
        self.status = status
        self.told()
