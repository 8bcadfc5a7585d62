"""Runs a graph behind a page to touch, and restarts it for another body, an effect or a reset."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from palpate.engine.graph import Graph
from palpate.launch.load.classes import takers
from palpate.launch.load.launchfile import SOURCES, LaunchFile
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import execute
from palpate.messages import ForceBand, Friction, Load
from palpate.nodes.base.effect import effects
from palpate.nodes.deformation import bodies
from palpate.physics.errors import PalpateError
from palpate.physics.scratch import ScratchFolder
from palpate.views.errors import PageError
from palpate.views.page.explain import bodies_of, explain_run
from palpate.views.page.feed import mesh_frame
from palpate.views.page.hard import HardCase, hard_cases
from palpate.views.page.live import ENDING, Live
from palpate.views.page.measuring import Figures, Measuring
from palpate.views.page.steered import Count, Pointers, Sample, Touched, steer_launch, touched_part


class PageRequest(msgspec.Struct, forbid_unknown_fields=True):
    """A message of a page: a pointer sample for a finger, a setting of its switches, a hard case, or the request to
    measure the bodies."""

    point: Sample | None = None
    finger: Count = 0
    body: str | None = None
    effect: tuple[str, bool] | None = None
    hard: str | None = None
    reset: bool = False
    measure: bool = False
    keep: bool | None = None


def choose_bodies(graph: Graph, touched: Touched) -> list[str]:
    """Bodies that can replace the shown one, by their name for `use:`."""
    several = takers(Load, graph.nodes[touched.body].cls)
    return [body for body in reversed(bodies()) if len(touched.fingers) == 1 or body in several]


def choose_effects(graph: Graph, touched: Touched) -> dict[str, bool]:
    """Effects that a page can switch, and whether they are on."""
    shown = touched.fingers[0]
    can = {effect.name for spec in graph.nodes.values() for effect in effects(spec.cls)}
    on = {"friction": Friction in shown, "relaxation": True, "band": ForceBand in shown}
    return {name: is_on for name, is_on in on.items() if name in can}


class EndedError(Exception):
    """A request of a page ended the build of a basis."""


class Session(Live):
    """Runs a graph in a separate thread and restarts it on request. The page that sent the last sample steers.

    launch  the graph to run
    folder  folder of recordings
    sets    overrides as for `--set`
    only    what to record, of `launchfile.RECORDED`; sources take 1 % of the bytes of all messages
    build   builds the bases that a graph lacks after a switch; takes the graph and what begins a stage of its progress
    measure error and time of bodies on the touch of a run (`studies.body_figures`), in another process

    PageError, GraphError: the graph cannot be steered, or its faults.
    """

    command = "palpate touch"

    def __init__(
        self, launch: LaunchFile, folder: Path, sets: list[str], only: str = SOURCES,
        build: Callable[[Graph, Any], None] = lambda graph, begin: None,
        measure: Callable[[LaunchFile, list[str]], Figures] | None = None,
    ) -> None:  # fmt: skip
        self._build, self._measure = build, measure and partial(measure, launch.but(overrides=sets))
        self.place = ScratchFolder("touch")
        self.launch, self.sockets = steer_launch(launch, Path(self.place.name))
        self.launch = self.launch.but(overrides=sets, only=only)
        self._graph: Graph | None = self.launch.load()
        self._planned = plan(self._graph)
        super().__init__(touched_part(self._planned))
        self.bodies = choose_bodies(self._graph, self.touched)
        self.folder = folder
        self.effects = choose_effects(self._graph, self.touched)
        """Effects that the page can switch, and whether they are on."""
        self.keep = True
        self.kept: list[Path] = []
        self.troubles: list[str] = []  # failures of nodes, and incomplete recordings
        self.number = 0
        self._wish = self.touched.use
        self._switched: dict[str, bool] = {}
        self._case: str | None = None
        self._measuring: Measuring | None = None
        self._ended = threading.Event()
        self._pointers = Pointers(self.sockets, self.touched.begins)
        self._runs = threading.Thread(target=self._live, name="runs", daemon=True)

    def open(self) -> None:
        self._runs.start()

    def close(self) -> None:
        """Shut the run down gracefully, so that its recording is complete."""
        self._ended.set()
        self.stopping.set()
        self._runs.join(ENDING)
        if self._measuring is not None:
            self._measuring.close()
        self._pointers.close()
        self.place.cleanup()

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Execute a request of a page. MsgspecError, PageError: it is invalid."""
        request = msgspec.json.decode(text, type=PageRequest)
        if request.point is not None:
            self._pointers.steer(page, request.finger, request.point)
        if request.keep is not None:
            self.keep = request.keep
        if request.body is not None or request.effect is not None or request.hard is not None or request.reset:
            self._restart(request.body, request.effect, request.hard)
        if request.measure and self._measure is not None and self._measuring is None:
            self.show_figures({"running": True})
            self._measuring = Measuring(partial(self._measure, self.bodies), self.show_figures)
        return []

    def show_figures(self, figures: Figures) -> None:
        """Send the error and time of each body to the pages."""
        self.figures = figures
        self.on_news()

    def leave(self, page: object) -> None:
        self._pointers.leave(page)

    def _restart(self, body: str | None, effect: tuple[str, bool] | None, case: str | None) -> None:
        """Restart the run, with another body, with an effect switched, or as a hard case. PageError: unknown one."""
        if body is not None and body not in self.bodies:
            raise PageError(f"body: found {body!r}, expected one of {', '.join(self.bodies)}")
        if effect is not None and effect[0] not in self.effects:
            raise PageError(f"effect: found {effect[0]!r}, expected one of {', '.join(self.effects) or 'none'}")
        if case is not None and case not in (known := [each.name for each in self._cases()]):
            raise PageError(f"hard: found {case!r}, expected one of {', '.join(known)}")
        if effect is not None:
            self.effects[effect[0]] = self._switched[effect[0]] = effect[1]
        self._wish, self._case = body or self.touched.use, case
        self.stopping.set()

    def _cases(self) -> list[HardCase]:
        return hard_cases(self._planned.graph, bodies_of(self._planned))

    # -- the thread ----------------------------------------------------------------------------------------------

    def _live(self) -> None:
        while not self._ended.is_set():
            self.stopping.clear()
            try:
                self._one_run()
            except EndedError:
                continue
            except (PalpateError, OSError) as error:
                self.say(f"stopped: {error}")
                self.stopping.wait()

    def _one_run(self) -> None:
        self.say("starting")
        switched = [f"effects.{name}={'on' if on else 'off'}" for name, on in self._switched.items()]
        graph, self._graph = self._graph, None
        if graph is None:
            launch = self.launch.but(overrides=[*switched, f"{self.touched.body}.use={self._wish}"])
            graph = launch.load()
            self._planned = plan(graph)
            case = next((each for each in self._cases() if each.name == self._case), None)
            if case is not None:
                graph = launch.but(overrides=case.overrides).load()
                self._planned = plan(graph)
            self._build(graph, self._building)
            self.touched = touched_part(self._planned)
        self.number += 1
        while (self.folder / f"{self.launch.graph.stem}-{self.number}.mcap").exists():  # of another program
            self.number += 1
        self.record = self.folder / f"{self.launch.graph.stem}-{self.number}.mcap"
        try:
            outcome = execute(
                self.launch.but(record=self.record, place=self.touched.place), graph, watch=self.on_update
            )
        finally:
            self.over()
        self.troubles += map(str, outcome.result.deaths)
        if self.keep and self.record.exists():
            self.kept.append(self.record)
            self.troubles += [outcome.lacking] if outcome.lacking else []
        else:
            self.record.unlink(missing_ok=True)
        if not self.stopping.is_set():
            self.say(f"stopped: the run has ended. {'; '.join(map(str, outcome.result.deaths))}"[:600])
            self.stopping.wait()

    def _building(self, name: str, note: str, total: float | None = 1.0) -> Callable[[float], None]:
        """Report a stage of the build of a basis on the page. A request of a page ends the build."""
        shown = -1

        def done(share: float) -> None:
            nonlocal shown
            if self.stopping.is_set():
                raise EndedError
            if (percent := 5 * int(20 * share)) != shown:
                shown = percent
                self.say(f"building the basis: {name}{f', {percent} %' if total else ''}: {note}")

        done(0.0)
        return done

    def show_begin(self) -> None:
        about = {"recording": str(self.record), "bodies": self.bodies, "effects": self.effects,
                 "measures": self._measure is not None, **explain_run(self._planned, self._case)}  # fmt: skip
        self.mesh = mesh_frame(self.touched, about)
