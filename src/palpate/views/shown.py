"""The part of a graph that pictures and pages show: the streams of each finger, and one surface of all bodies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import msgspec
import numpy as np

from palpate.engine.imports import full_name
from palpate.engine.parts import SUPPORT, Link, parts
from palpate.engine.plan import Plan
from palpate.messages import Contact, Friction, Load, Message, Proximity, Surface
from palpate.messages.contact import Neighbour, OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base.surface import complete
from palpate.physics.geometry.mesh import Mesh
from palpate.records.stored import Stored
from palpate.views.carried import Carried
from palpate.views.errors import PageError, PictureError

NO_MOVES: Mapping[str, str] = MappingProxyType({})
Streams = Mapping[str, tuple[str, str]]  # sender and full type name of each stream


class Finger(dict[str, str]):
    """A finger's stream of each message type, by the type's full name.

    near      its streams of Proximity, one for each organ
    supports  of each of them, the stream of the motion in whose frame it is; "": of an organ that does not move
    """

    def __init__(self) -> None:
        self.near: list[str] = []
        self.supports: list[str] = []


def fingers(links: Iterable[Link], streams: Streams) -> list[Finger]:
    """The streams of each finger, in the order of the graph.

    links  links between the nodes, without those between organs

    Streams that do not belong to one finger (`engine.parts`) are shared by all. The sum of the contacts or frictions of
    one finger replaces them. A single finger, or one with unknown links, gets the first stream of each type.
    """
    # Assign each node to a finger; a node that only reads one finger belongs to it.
    links = list(links)
    part = parts(links)
    inputs: dict[str, set[str]] = {}
    for reader, _, sender in links:
        inputs.setdefault(reader, set()).add(sender)
    for node in inputs:
        numbers = {part.get(sender) for sender in inputs[node]}
        if node not in part and len(numbers) == 1 and None not in numbers:
            part[node] = numbers.pop() or 0
    # Collect the streams of each finger that touches.
    contact, near = full_name(Contact), full_name(Proximity)
    found = dict.fromkeys(part.get(p) for p, kind in streams.values() if kind == contact)
    several = len(found) > 1 and None not in found
    each: list[Finger] = []
    for number in found if several else [None]:
        own_streams = {s: given for s, given in streams.items() if not several or part.get(given[0], number) == number}
        finger = Finger()
        senders: dict[str, set[str]] = {}
        for stream, (producer, kind) in own_streams.items():
            adds_up = kind in _ADDED and bool(senders.get(kind, set()) & inputs.get(producer, set()))
            if adds_up or kind not in finger:
                finger[kind] = stream
            senders.setdefault(kind, set()).add(producer)
            if kind == near:
                finger.near.append(stream)
                finger.supports.append(_support_of(producer, links))
        each.append(finger)
    return each


def _support_of(collision: str, links: Sequence[Link]) -> str:
    """The motion in whose frame a collision gets the pose; "" if it does not move."""
    poses = {sender for reader, port, sender in links if reader == collision and port == "pose"}
    return next((sender for reader, port, sender in links if reader in poses and port == SUPPORT), "")


_ADDED = {full_name(Contact), full_name(Friction)}


_OF_ORGANS = {full_name(OrganContact), full_name(Neighbour)}


def links_of_plan(planned: Plan) -> tuple[list[Link], Streams]:
    """The links between nodes of a plan without those between organs, and its streams."""
    nodes = planned.graph.nodes
    streams = {s: (n, full_name(kind)) for n in planned.order for s, kind in nodes[n].streams.items()}
    edges = ((name, edge) for name in planned.order for edge in planned.edges[name])
    return [(n, e.port, e.producer) for n, e in edges if streams[e.stream][1] not in _OF_ORGANS], streams


def links_of(recording: Stored) -> tuple[list[Link], Streams]:
    """The same of a recording."""
    streams = {name: (s.producer, str(s.schema["class"])) for name, s in recording.streams.items()}
    links = [
        (name, edge["port"], edge["producer"])
        for name, incoming in recording.about.get("plan", {}).get("edges", {}).items()
        for edge in incoming
        if streams.get(edge["stream"], ("", ""))[1] not in _OF_ORGANS
    ]
    return links, streams


def moves_of_plan(planned: Plan) -> dict[str, str]:
    """The stream of the motion of each body that moves (support.Moving, support.Foundation)."""
    nodes = planned.graph.nodes
    return {
        body: name for name in planned.order if Support in nodes[name].streams.values()
        for body in nodes[name].settings.get("moves", ())
    }  # fmt: skip


def moves_of(recording: Stored) -> dict[str, str]:
    """The same of a recording."""
    kind, nodes = full_name(Support), recording.about.get("plan", {}).get("nodes", ())
    settings = {node.get("name"): node.get("settings", {}) for node in nodes}
    motions = [stream for stream, held in recording.streams.items() if str(held.schema["class"]) == kind]
    return {body: stream for stream in motions for body in settings.get(stream, {}).get("moves", ())}


def _nearest_mesh(body: str, links: Sequence[Link], mesh: Callable[[str], Mesh]) -> Mesh:
    """The mesh of a body, or of the nearest node upstream. PictureError, PageError: no such node."""
    try:
        return mesh(body)
    except (PictureError, PageError) as error:
        missing = error
    upstream = [body]
    for node in upstream:
        upstream += dict.fromkeys(sender for reader, _, sender in links if reader == node and sender not in upstream)
    for node in upstream[1:]:
        with contextlib.suppress(PictureError, PageError):
            return mesh(node)
    raise missing


@dataclass(frozen=True)
class Bodies:
    """Bodies with a mesh, in the order of the graph.

    streams  stream of each body's surface
    meshes   undeformed mesh of each body
    loads    streams of loads, with the index of the body that each presses
    others   streams of bodies without a mesh
    supports stream of the motion of each body, "" if it does not move
    """

    streams: Sequence[str]
    meshes: Sequence[Mesh]
    loads: Mapping[str, int]
    others: Sequence[str] = ()
    supports: Sequence[str] = ()

    @classmethod
    def of(
        cls, links: Iterable[Link], streams: Streams, mesh: Callable[[str], Mesh], moves: Mapping[str, str] = NO_MOVES
    ) -> Bodies:
        """The bodies of all surfaces; `mesh` makes that of a node. A body without a mesh has that of the nearest node
        upstream which has one: the node that spreads the load, or the collision. PictureError, PageError: the first
        body has none.

        moves  stream of the motion of each body that moves
        """
        links = list(links)
        surfaces = {producer: stream for stream, (producer, kind) in streams.items() if kind == full_name(Surface)}
        meshes: dict[str, Mesh] = {}
        for body, stream in surfaces.items():
            try:
                meshes[stream] = _nearest_mesh(body, links, mesh)
            except (PictureError, PageError):
                if not meshes:
                    raise
        shown = list(meshes)
        pressed = {sender: surfaces[reader] for reader, _, sender in links if surfaces.get(reader) in meshes}
        senders = {s: producer for s, (producer, kind) in streams.items() if kind == full_name(Load)}
        loads = {s: shown.index(pressed[producer]) for s, producer in senders.items() if producer in pressed}
        others = [s for s in surfaces.values() if s not in meshes]
        supports = [moves.get(body, "") for body, stream in surfaces.items() if stream in meshes]
        return cls(shown, list(meshes.values()), loads, others, supports)

    @property
    def left_out(self) -> str:
        """A line on bodies that are not shown; "" if all are."""
        return f"not shown: {', '.join(map(repr, self.others))}, without a mesh" if self.others else ""

    @cached_property
    def mesh(self) -> Mesh:
        if len(self.meshes) == 1:
            return self.meshes[0]
        triangles = [m.triangles + first for m, first in zip(self.meshes, self._first, strict=True)]
        return Mesh(np.concatenate([m.vertices for m in self.meshes]), np.concatenate(triangles))

    @cached_property
    def _first(self) -> list[int]:
        """Index of each body's first vertex in the joint mesh."""
        return [0, *np.cumsum([len(m.vertices) for m in self.meshes])[:-1].tolist()]

    def surface(self, newest: Mapping[str, Surface]) -> Surface | None:
        """The surfaces of these streams as one Surface on the joint mesh, with pressure and slip if all bodies send
        them. Bodies without a message are at rest; None if no body has one. Other fields are those of the first."""
        shapes = [
            (first, complete(newest[stream], mesh.vertices))
            for stream, mesh, first in zip(self.streams, self.meshes, self._first, strict=True)
            if stream in newest
        ]
        if len(shapes) < 2:
            return next((msgspec.structs.replace(s, nodes=s.nodes + first) for first, s in shapes), None)
        every = [surface for _, surface in shapes]
        sent = [name for name in ("pressure", "slipped") if all(len(getattr(s, name)) == len(s.nodes) for s in every)]
        more = {name: np.concatenate([getattr(s, name) for s in every]) for name in sent}
        more |= {name: getattr(every[0], name)[:0] for name in ("pressure", "slipped") if name not in more}
        return msgspec.structs.replace(
            every[0], nodes=np.concatenate([s.nodes + first for first, s in shapes]),
            displacement=np.concatenate([s.displacement for s in every]), **more,
        )  # fmt: skip

    def carried(self, newest: Mapping[str, Message]) -> list[tuple[int, int, Carried]]:
        """First vertex, end, and motion of each body that has moved."""
        moved = []
        for first, mesh, stream in zip(self._first, self.meshes, self.supports, strict=False):
            if isinstance(support := newest.get(stream), Support):
                moved.append((first, first + len(mesh.vertices), Carried.by(support)))
        return moved

    def pressed_area(self, newest: Mapping[str, Load]) -> dict[str, list]:
        """Vertices of the joint mesh that these loads press, `patch`, and the size of each force [N], `loads`."""
        patch: list[int] = []
        sizes: list[float] = []
        for stream, load in newest.items():
            patch += (load.nodes + self._first[self.loads[stream]]).tolist()
            sizes += np.round(np.linalg.norm(load.forces, axis=1), 6).tolist()
        return {"patch": patch, "loads": sizes} if newest else {}
