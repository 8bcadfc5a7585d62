"""The scene's key `motions`: organs that move with their foundations, and all that touches them in their frame.

    motions:
      breathing: {moves: [liver, kidney], amplitude: [0, 11 mm, 0], period: 4 s, waveform: breathing}

A motion is a node of its name, a support.Moving. Each finger that touches a moved body gets a support.Relative: its
pose in the frame of the body, which replaces the pose for the collision and for all nodes that read the contact.
Contacts of organs get the supports of their bodies, and an energy balance that of its body. The graph without the key
is unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.engine.faults import Faults, Location, choices
from palpate.launch.load.classes import ClassError, find_class
from palpate.launch.load.files import MOTIONS as KEY
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Contact, Contacts, Ledger, Load, Message, Pose, Proximity, Surface
from palpate.messages.contact import OrganContact
from palpate.messages.wording import written
from palpate.nodes.base import Node, Observer, inputs, outputs
from palpate.nodes.base.carrier import Carrier

EXAMPLE = "`motions: {breathing: {moves: [tissue], amplitude: [0, 11 mm, 0], period: 4 s, waveform: breathing}}`"
Frames = frozenset[str | None]
"""Motions of the organs that a contact belongs to; None: an organ that does not move."""


@dataclass
class _Line:
    """A node of the graph file: class, and the senders of each input as written."""

    name: str
    cls: type[Node]
    data: dict[str, Any]

    def senders(self, kind: type[Message]) -> list[str]:
        """Names of the senders at the inputs of this type."""
        return [node for port in self.ports(kind) for node in _names(self.given(port))]

    def ports(self, kind: type[Message]) -> list[str]:
        return [port.name for port in inputs(self.cls) if issubclass(port.type, kind)]

    def given(self, port: str) -> Any:
        inside = self.data.get("in")
        return inside.get(port) if isinstance(inside, dict) else None

    def sends(self, *kinds: type[Message]) -> bool:
        return bool(set(outputs(self.cls)) & set(kinds))


def add_motions(graph: YamlSource, scene: YamlSource, faults: Faults) -> list[str]:
    """Add the motions of a scene to a graph. Returns notes."""
    given, nodes = scene.data.get(KEY), graph.data.get("nodes")
    if given in (None, {}):
        scene.data.pop(KEY, None)
    if not given or not isinstance(nodes, dict):
        return []
    if not isinstance(given, dict):
        faults.add(f"{KEY}: found {written(given)}, expected a mapping of names to motions", EXAMPLE, scene.place(KEY))
        return []
    lines = {line.name: line for line in _lines(nodes)}
    moved: dict[str, str] = {}
    for name, motion in given.items():
        if _is_motion(nodes.get(name)):
            continue  # the graph of a recording has the lines already
        place = scene.place(KEY, name)
        if name in nodes:
            faults.add(f"{KEY}: {name!r} is the name of a node", "Another name for the motion.", place)
            continue
        for body in _bodies(name, motion, lines, place, faults):
            if moved.setdefault(body, name) != name:
                faults.add(f"{KEY}: {body!r} is moved by {moved[body]!r} and {name!r}", "One motion for each body: a "
                           "motion has both a wave and a `path`.", place)  # fmt: skip
        _put(graph, name, {"use": "support.Moving", "with": f"${KEY}.{name}"}, place)
    return list(_Wiring(graph, lines, moved, scene.place(KEY)).connect(faults)) if moved else []


def _is_motion(line: Any) -> bool:
    return isinstance(line, dict) and line.get("use") == "support.Moving"


def _bodies(name: str, motion: Any, lines: Mapping[str, _Line], place: Location, faults: Faults) -> Iterator[str]:
    """The bodies that a motion moves. A fault for each that the graph lacks."""
    moves = motion.get("moves") if isinstance(motion, dict) else None
    if not (isinstance(moves, list) and moves):
        faults.add(f"{KEY}: {name!r} has no list `moves`", EXAMPLE, place)
        return
    known = [each.name for each in lines.values() if each.sends(Surface) and not each.sends(Contact)]
    for body in moves:
        if body in known:
            yield body
        else:
            text = f"{KEY}: {name!r} moves {written(body)}, which is no body of the graph"
            faults.add(text, choices("Bodies", str(body), known), place)


def _lines(nodes: Mapping[str, Any]) -> Iterator[_Line]:
    """The nodes whose classes are found; the loader reports the others."""
    for name, data in nodes.items():
        if not (isinstance(data, dict) and isinstance(data.get("use"), str)):
            continue
        try:
            cls = find_class(data["use"])
        except ClassError:
            continue
        if not issubclass(cls, Observer):
            yield _Line(name, cls, data)


def _names(value: Any) -> list[str]:
    """The nodes that are named as senders of an input."""
    several = value if isinstance(value, list) else [value]
    named = (one.get("from") if isinstance(one, dict) else one for one in several)
    return [name.partition(".")[0] for name in named if isinstance(name, str)]


def _put(graph: YamlSource, name: str, line: dict[str, Any], place: Location) -> None:
    graph.put(("nodes", name), YamlSource(line, {(): place}))


class _Wiring:
    """Connects motions to a graph. moved: the motion of each body that moves."""

    def __init__(self, graph: YamlSource, lines: dict[str, _Line], moved: dict[str, str], place: Location) -> None:
        self.graph, self.lines, self.moved, self.place = graph, lines, moved, place
        self._frames: dict[str, Frames] = {}

    def connect(self, faults: Faults) -> Iterator[str]:
        """Change the inputs of all nodes that touch a moved body. Yields notes."""
        for line in self.lines.values():
            if line.sends(Proximity):
                frames = self._of_collision(line)
                if len(frames) > 1:
                    faults.add(f"{KEY}: {line.name!r} collides with organs that move differently",
                               "One collision for each organ.", self.place, node=line.name)  # fmt: skip
                    continue
            elif line.ports(Contact) and not line.sends(Contact):
                frames = frozenset().union(*map(self.frames, line.senders(Contact)))
            else:
                frames = frozenset()
            if frames == {None} or not line.ports(Pose):
                pass
            elif len(frames) > 1:
                yield (
                    f"{line.name}: the organs of its finger move differently, so that it counts the work of their "
                    "foundations as that of the display: while they push the hand, passivity may withhold force"
                )
            elif frames:
                self._see_from(line, *frames)
            if line.sends(OrganContact):
                self._support_sides(line)
            if line.sends(Ledger):
                for motion in {self.moved.get(self._origin(body)) for body in _names(line.given("body"))} - {None}:
                    self._set(line, "support", motion)

    def frames(self, name: str) -> Frames:
        """The motions of the organs of a contact."""
        name = self._origin(name)
        line = self.lines.get(name)
        if line is None or not line.sends(Contact, Contacts):
            return frozenset()
        if name not in self._frames:
            self._frames[name] = frozenset()  # ends a cycle
            bodies, solvers = line.senders(Surface), line.senders(Contacts) or line.senders(Contact)
            of_bodies = frozenset(self.moved.get(self._origin(body)) for body in bodies)
            self._frames[name] = of_bodies or frozenset().union(*map(self.frames, solvers))
        return self._frames[name]

    def _of_collision(self, line: _Line) -> Frames:
        """The motions of the organs whose contacts read a collision."""
        readers = (
            each.name for each in self.lines.values()
            if each.sends(Contact, Contacts) and line.name in map(self._origin, each.senders(Proximity))
        )  # fmt: skip
        return frozenset().union(*map(self.frames, readers))

    def _origin(self, name: str) -> str:
        """The node whose messages a chain of carriers forwards."""
        seen = set[str]()
        while name in self.lines and issubclass(self.lines[name].cls, Carrier) and name not in seen:
            seen.add(name)
            name = next(iter(_names(self.lines[name].given("message"))), name)
        return name

    def _see_from(self, line: _Line, motion: str | None) -> None:
        """Replace the poses that a node reads by those in the frame of a motion."""
        for port in line.ports(Pose):
            given = line.given(port)
            seen = [self._relative(one, str(motion)) for one in (given if isinstance(given, list) else [given]) if one]
            if seen:
                self._set(line, port, seen if isinstance(given, list) else seen[0])

    def _relative(self, pose: Any, motion: str) -> str:
        """The node that sends a pose, as written, in the frame of a motion."""
        name = f"{_names(pose)[0]}-{motion}"
        if name not in self.graph.data["nodes"]:
            line = {"use": "support.Relative", "in": {"pose": pose, "support": motion}}
            _put(self.graph, name, line, self.place)
        return name

    def _support_sides(self, line: _Line) -> None:
        """Give a contact of organs the motions of its bodies."""
        for side in self.lines.values():
            if not (side.sends(Load) and line.name in side.senders(OrganContact)):
                continue
            bodies = [each.name for each in self.lines.values() if side.name in each.senders(Load)]
            for motion in {self.moved.get(body) for body in bodies} - {None}:
                self._set(line, f"{side.data.get('side', 'first')}_support", motion)

    def _set(self, line: _Line, port: str, sender: Any) -> None:
        self.graph.put(("nodes", line.name, "in", port), YamlSource(sender, {(): self.place}))
