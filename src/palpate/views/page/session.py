"""Runs a graph behind a page to touch, and restarts it for another body, an effect or a reset."""

import threading
from collections.abc import Callable
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
from palpate.views.page.feed import mesh_frame
from palpate.views.page.live import ENDING, Live
from palpate.views.page.steered import Count, Pointers, Sample, Touched, steer_launch, touched_part


class PageRequest(msgspec.Struct, forbid_unknown_fields=True):
    """A message of a page: a pointer sample for a finger, or a setting of its switches."""

    point: Sample | None = None
    finger: Count = 0
    body: str | None = None
    effect: tuple[str, bool] | None = None
    reset: bool = False
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

    PageError, GraphError: the graph cannot be steered, or its faults.
    """

    command = "palpate touch"

    def __init__(
        self, launch: LaunchFile, folder: Path, sets: list[str], only: str = SOURCES,
        build: Callable[[Graph, Any], None] = lambda graph, begin: None,
    ) -> None:  # fmt: skip
        self._build = build
        self.place = ScratchFolder("touch")
        self.launch, self.sockets = steer_launch(launch, Path(self.place.name))
        self.launch = self.launch.but(overrides=sets, only=only)
        self._graph: Graph | None = self.launch.load()
        super().__init__(touched_part(plan(self._graph)))
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
        self._pointers.close()
        self.place.cleanup()

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Execute a request of a page. MsgspecError, PageError: it is invalid."""
        request = msgspec.json.decode(text, type=PageRequest)
        if request.point is not None:
            self._pointers.steer(page, request.finger, request.point)
        if request.keep is not None:
            self.keep = request.keep
        if request.body is not None or request.effect is not None or request.reset:
            self._restart(request.body, request.effect)
        return []

    def leave(self, page: object) -> None:
        self._pointers.leave(page)

    def _restart(self, body: str | None, effect: tuple[str, bool] | None) -> None:
        """Restart the run, with another body or with an effect switched. PageError: unknown body or effect."""
        if body is not None and body not in self.bodies:
            raise PageError(f"body: found {body!r}, expected one of {', '.join(self.bodies)}")
        if effect is not None and effect[0] not in self.effects:
            raise PageError(f"effect: found {effect[0]!r}, expected one of {', '.join(self.effects) or 'none'}")
        if effect is not None:
            self.effects[effect[0]] = self._switched[effect[0]] = effect[1]
        self._wish = body or self.touched.use
        self.stopping.set()

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
            graph = self.launch.but(overrides=[*switched, f"{self.touched.body}.use={self._wish}"]).load()
            self._build(graph, self._building)
            self.touched = touched_part(plan(graph))
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
        about = {"recording": str(self.record), "bodies": self.bodies, "effects": self.effects}
        self.mesh = mesh_frame(self.touched, about)
