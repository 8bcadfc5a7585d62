"""The same meeting by the bodies of the library: contact.Between, two contact.Side and two bodies, one segment.

The foundation of the upper body moves down along z. As in a fused run, the nodes are one call per tick, see
`studies.accuracy.chain`; without fingers, only the contact loads the bodies.
"""

import gc
import json
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats
from palpate.compiler.trust import make_folder
from palpate.engine.job import InputJob, NodeJob
from palpate.engine.segment import CompiledSegment, segments
from palpate.engine.slot import NodeError, Slot
from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, CompiledNode, Node, Out, SettingError
from palpate.nodes.base import outputs as outputs_of
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.nodes.contact.between import Between
from palpate.nodes.contact.side import Side
from palpate.nodes.deformation import ReducedFE
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.mesh import write_ply
from palpate.studies.accuracy.bases import ready
from palpate.studies.accuracy.chain import Awake
from palpate.studies.accuracy.sites import cache
from palpate.studies.meeting.solids import BALL, MEETINGS, SOLIDS, Meeting

FILE_EDGES = 36  # edges of a surface in a file along each edge of the cube: 7800 vertices
START = 2e-4  # [m] gap of the undeformed surfaces at the start
REACH = 12e-3  # [m] of the candidates
UPSIDE_DOWN = (float(np.pi / np.sqrt(2.0)), float(np.pi / np.sqrt(2.0)), 0.0)
"""[rad] Rotation vector of `solids.TURN`."""


@dataclass(frozen=True)
class MeetingRun:
    """Force [N], area of contact [m²] and number of active candidates (T,), the processor times of the ticks of more
    runs [s], the nodes, and the time [s] before the first tick."""

    force: np.ndarray
    area: np.ndarray
    active: np.ndarray
    seconds: np.ndarray
    nodes: list[Node]
    offline: float


class _Descent(CompiledNode):
    """Sends the displacement and velocity of the upper foundation, one row per tick. A motion without its velocity
    would be a leap, which the contact withholds."""

    paced = True
    State = {"tick": int, "rows": ARRAY}

    def __init__(self, rows: np.ndarray) -> None:
        super().__init__()
        self._rows = rows

    def start(self) -> None:
        super().start()
        self.hold("rows", self._rows)

    @kernel
    def compute(own, out: Out[Support], dt):
        before, out.displacement[2] = out.displacement[2], floats(own.rows)[own.tick]
        out.velocity[2] = (out.displacement[2] - before) / dt if own.tick > 0 else 0.0
        own.tick += 1


def surface_settings(name: str, upper: bool, vertices: int) -> dict[str, Any]:
    """Settings of the surface of a solid at its place."""
    solid = SOLIDS[name]
    high = BALL if solid.built_in == "sphere" else 0.0
    place: dict[str, Any] = {"position": (0.0, 0.0, START + high) if upper else (0.0, 0.0, -high), "spacing": 0.0}
    if upper:
        place["rotation"] = UPSIDE_DOWN
    if solid.built_in:
        return place | {"surface": solid.built_in, "vertices": vertices}
    path = cache() / "meeting" / f"{name}-{FILE_EDGES}.ply"
    if not path.is_file():
        make_folder(path.parent)
        write_ply(path, solid.surface(FILE_EDGES))
    return place | {"surface": str(path), "refine": 0.0}


def run(
    meeting: Meeting,
    cls: type[Node],
    settings: dict[str, Any],
    closings: np.ndarray,
    rate: float = 1000.0,
    repeats: int = 0,
    vertices: int = 10000,
    cells: int = Between.cells,
    alone: bool = False,
) -> MeetingRun:
    """A meeting of two bodies of a class with these settings, at the closings [m] (T,) of the ticks at a rate [Hz].

    `alone`: only the contact, which has the compliances of both bodies, so that its force is the same. One pass
    collects the messages, `repeats` more measure the times. SettingError: bodies that cannot touch organs.
    """
    begun = time.perf_counter()
    given, bodies = list[dict[str, Any]](), list[Node]()
    for name, upper in ((meeting.upper, True), (meeting.lower, False)):
        surface = surface_settings(name, upper, vertices)
        material = settings | (surface if issubclass(cls, OnThinnedSurface) else {})
        given.append({"use": cls.__name__, "settings": material, "surface": surface})
        bodies.append(body := cls(**material))
        if isinstance(body, ReducedFE):
            ready(body)
    between = Between(bodies=json.dumps(given), reach=REACH, cells=cells)
    sides = [Side(side=side, **each["surface"]) for side, each in zip(("first", "second"), given, strict=True)]
    slots = [
        _slot("down", _Descent(-START - np.asarray(closings, float))),
        _slot("between", between, first_support="down"),
        _slot("one", sides[0], contact="between"),
        _slot("two", sides[1], contact="between"),
        _slot("upper", bodies[0], load="one"),
        _slot("lower", bodies[1], load="two"),
    ][: 2 if alone else None]
    _start(slots)
    outputs = {slot.name: slot.outputs[0] for slot in slots}
    for slot in slots:
        slot.wire(outputs)
    part, *more = segments(slots, lambda some: CompiledSegment(some, rate, False, lambda *_: 0.0, lambda *_: None))
    if more or not isinstance(part, CompiledSegment):
        raise SettingError(f"{cls.__name__}: not compiled, expected a body that contact.Between takes")
    offline = time.perf_counter() - begun
    found, seconds = [], []
    for tick in range(len(closings)):
        part.advance(tick)
        sent = outputs["between"].last
        assert isinstance(sent, OrganContact)
        found.append((sent.force, sent.area, int(between._held["pair.active.tally"][0]["active"])))
    for _ in range(repeats):
        _start(slots)
        spent = np.empty(len(closings))
        gc.collect()
        gc.disable()
        try:
            for tick in range(len(closings)):
                before = time.thread_time_ns()
                part.advance(tick)
                spent[tick] = time.thread_time_ns() - before
        finally:
            gc.enable()
        seconds.append(1e-9 * spent)
    force, area, active = (np.array(column) for column in zip(*found, strict=True))
    every = np.concatenate(seconds) if seconds else np.zeros(0)
    return MeetingRun(force, area, active, every, [slot.node for slot in slots], offline)


def _slot(name: str, node: Node, **inputs: str) -> Slot:
    wires = tuple(InputJob(port, sender, sender) for port, sender in inputs.items())
    streams = tuple(f"{name}.{k}" if k else name for k in range(len(outputs_of(type(node)))))
    return Awake(NodeJob(name, "", {}, 1, wires, streams), node, ())


def _start(slots: list[Slot]) -> None:
    for slot in slots:
        try:
            slot.begin()
        except NodeError as fault:
            raise fault.cause if isinstance(fault.cause, Exception) else fault from None


def choose_meetings(names: list[str] | None) -> list[str]:
    """These names of meetings, by default all. ArgumentError: an unknown one."""
    for name in names or ():
        if name not in MEETINGS:
            raise ArgumentError(f"meeting: found {name!r}, expected one of {', '.join(MEETINGS)}")
    return list(names or MEETINGS)
