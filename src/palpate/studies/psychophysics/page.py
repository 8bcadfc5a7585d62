"""An experiment on the page of `palpate touch`: texts, intervals with the mouse or a device, questions."""

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import RunOutcome, execute
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.reports import Prepare
from palpate.launch.run.work.spawner import Spawner, worker_server
from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.scratch import ScratchFolder
from palpate.studies.psychophysics.file import stored_answer
from palpate.studies.psychophysics.schedule import Trial
from palpate.studies.psychophysics.session import Answer, DisturbedError, Presenter
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.views.errors import PageError
from palpate.views.page.feed import mesh_frame
from palpate.views.page.live import ENDING, Live
from palpate.views.page.steered import Count, Pointers, Sample, steer_launch, touched_part

LOOK = 0.2  # [s] Period of the check whether the page was closed
MOMENT = 1.0  # [s] Duration of a title without a text


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """Message of the page: a sample of the pointer, or the number of a completed panel with the answer and the response
    time [s]."""

    point: Sample | None = None
    finger: Count = 0
    shown: Count | None = None
    answer: Annotated[str, msgspec.Meta(max_length=100)] = ""
    seconds: Annotated[float, msgspec.Meta(ge=0, le=1e6)] = 0.0


class ClosedError(Exception):
    """The page was closed; the session can be resumed later."""


class ExperimentPage(Live):
    """Presenter for a participant, who touches with the device of the graph or, without a device, with the pointer.

    stimuli  stimuli of the experiment
    session  runs all trials with a presenter

    PageError, GraphError: the graph cannot be touched.
    """

    command = "palpate experiment"

    def __init__(self, stimuli: Stimuli, session: Callable[[Presenter], None]) -> None:
        self.experiment, self._session = stimuli.experiment, session
        self._place = ScratchFolder("experiment")
        graph, sockets = stimuli.launch.load(), list[Path]()
        self._file: Path | None = None
        self.mouse = not any(spec.cls.hardware for spec in graph.nodes.values())
        if self.mouse:
            launch, sockets = steer_launch(stimuli.launch, Path(self._place.name))
            self._file, graph = launch.graph, launch.load()
        for block, levels in stimuli.levels.items():  # the node that replaces the hand may lack a setting
            self._steered_run(stimuli.run(block, levels[0])).load()
        super().__init__(touched_part(plan(graph)))
        self.panel = {"title": "starting", "text": ""}
        self._pointers = Pointers(sockets, self.touched.begins)
        self._modules = sorted({spec.cls.__module__ for spec in graph.nodes.values()})
        self._servers: list[ForkServer | Spawner] = []
        self._done: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self._closed, self._ended = threading.Event(), threading.Event()
        self._pages: set[object] = set()
        self._left = False
        self._error: BaseException | None = None
        self._shown, self._since = 0, 0.0
        self._reloaded = False  # the page was reloaded while the panel is shown, so its response time is unknown
        self._trials = threading.Thread(target=self._live, name="experiment", daemon=True)

    # -- as a source of the page ---------------------------------------------------------------------------------

    def open(self) -> None:
        self._trials.start()

    def close(self) -> None:
        """Stop the running interval; its trial is presented again when the session is resumed."""
        self._closed.set()
        self.stopping.set()
        self._trials.join(ENDING)
        for server in self._servers:
            server.close()
        self._pointers.close()
        self._place.cleanup()

    @property
    def ended(self) -> bool:
        return self._ended.is_set()

    def check(self) -> None:
        """Raise the error that ended the session early."""
        if self._error is not None:
            raise self._error

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Handle a message of the page. MsgspecError, PageError: it is invalid."""
        order = msgspec.json.decode(text, type=Order)
        self._pages.add(page)
        if order.point is not None and self.mouse:
            self._pointers.steer(page, order.finger, order.point)
        panel = self.panel or {}
        if order.shown is not None and order.shown == panel.get("shown"):
            if panel.get("interval"):
                self.stopping.set()
            else:
                self._check_answer(panel, order)
                if self._reloaded:
                    order.seconds = time.monotonic() - self._since
                self._done.put(order)
        return []

    def leave(self, page: object) -> None:
        self._pages.discard(page)
        self._reloaded = True
        self._pointers.leave(page)
        if not self._pages and (self.panel or {}).get("interval"):
            self._left = True
            self.stopping.set()

    def say(self, status: str) -> None:
        """Ignore the status of the run: the page shows the trial instead."""
        if status != "running":
            super().say(status)

    def show_begin(self) -> None:
        """Uncover the picture when an interval begins."""
        self.mesh = mesh_frame(self.touched, {"watch": not self.mouse, "bodies": [], "effects": {}})
        self._cover(interval=True, end_key=self.experiment.end_key, show=self.experiment.show)

    # -- as a presenter, in a separate thread --------------------------------------------------------------------

    def show(self, trial: Trial | None, title: str, text: str, pause: float = 0.0) -> None:
        self._say_trial(trial)
        if trial is None or not text:
            self._cover(title=title, text=text, over=trial is None)
            self._closed.wait(MOMENT)
        else:
            self._cover(
                title=title, text=text, wait=pause, buttons=[{"label": "continue", "key": "Enter", "answer": ""}]
            )
            self._warm()
            self._await_answer()

    def present(self, trial: Trial, interval: int, launch: LaunchFile) -> None:
        several = self.experiment.intervals > 1
        self._say_trial(trial, f"interval {interval} of {self.experiment.intervals}" if several else "")
        self._cover(title=f"{'First' if interval == 1 else 'Second'} interval" if several else "", text="")
        self.stopping.clear()
        self._left, until = False, time.monotonic() + self.experiment.gap
        launch = self._steered_run(launch)
        graph = launch.load()
        self.touched = touched_part(plan(graph))
        self._closed.wait(max(until - time.monotonic(), 0.0))
        if self._closed.is_set():
            raise ClosedError
        outcome = self._run(replace(launch, clock="real", pace=None, place=self.touched.place), graph)
        self._cover(title="", text="")
        if self._closed.is_set():
            raise ClosedError
        if outcome.result.deaths:
            raise DisturbedError(f"The interval was interrupted: {outcome.result.deaths[0]}")
        if self._left:
            raise DisturbedError("The page was closed during the interval.")
        if not outcome.ok:
            raise RunError("; ".join(outcome.result.notes) or f"the recording {launch.record} is not whole")

    def ask(self, trial: Trial) -> Answer:
        keys = self.experiment.keys
        self._say_trial(trial)
        self._cover(
            title=self.experiment.question, text="", number=not keys,
            buttons=[{"label": name, "key": key, "answer": name} for name, key in keys.items()],
        )  # fmt: skip
        self._warm()
        order = self._await_answer()
        return Answer(order.answer, order.seconds)

    def _live(self) -> None:
        try:
            self._session(self)
        except ClosedError:
            pass
        except Exception as error:  # the command raises it
            self._error = error
            self._cover(title="The experiment has stopped", text=str(error), over=True)
        finally:
            self._closed.wait(MOMENT)
            self._ended.set()

    def _run(self, launch: LaunchFile, graph: Any) -> RunOutcome:
        server = self._servers.pop(0) if self._servers else worker_server()
        try:
            return execute(launch, graph, watch=self.on_update, forkserver=server)
        finally:
            self.over()
            server.close()

    def _steered_run(self, launch: LaunchFile) -> LaunchFile:
        """The run with the pointer instead of the simulated hand."""
        return launch if self._file is None else replace(launch, graph=self._file, scene=None, path=None)

    def _warm(self) -> None:
        """Import the modules of the next intervals while the participant reads, so that each starts without delay."""
        while len(self._servers) < self.experiment.intervals:
            self._servers.append(worker_server())
            self._servers[-1].ask(Prepare(self._modules))

    def _cover(self, **panel: Any) -> None:
        """Cover the picture with a panel."""
        self._shown, self._since, self._reloaded = self._shown + 1, time.monotonic(), False
        self.panel = {"shown": self._shown, **panel}
        self.on_news()

    def _say_trial(self, trial: Trial | None, what: str = "") -> None:
        if trial is not None:
            total = f" of {trial.total}" if trial.total else ""
            self.say(f"trial {trial.number}{total}{' · ' * bool(what)}{what}")

    def _check_answer(self, panel: dict[str, Any], order: Order) -> None:
        """Give the answer its stored form. PageError: the panel does not offer this answer."""
        if panel.get("number"):
            try:
                order.answer = stored_answer(self.experiment.response, order.answer)
            except ArgumentError as error:
                raise PageError(str(error)) from None
        elif order.answer not in [button["answer"] for button in panel.get("buttons", ())]:
            raise PageError(f"found {order.answer!r}, expected one of the answers that are shown")

    def _await_answer(self) -> Order:
        """Wait for the participant to complete the panel. ClosedError: the page was closed."""
        while not self._closed.is_set():
            try:
                order = self._done.get(timeout=LOOK)
            except queue.Empty:
                continue
            if order.shown == self._shown:
                return order
        raise ClosedError
