"""The scene's keys `motions` and `foundations`: organs that move, and all that touches them in their frame.

    motions:
      breathing: {moves: [liver, kidney], amplitude: [0, 11 mm, 0], period: 4 s, waveform: breathing}
    foundations:
      foundation: {moves: [spleen], mass: 150 g, stiffness: 100 N/m, damping: 4 N s/m, attached: false}

A motion is a node of its name, a support.Moving; a foundation, on which fingers move an organ, a support.Foundation
with the contacts of the organ, whose controllers get a support.Absolute. Each finger that touches a moved body gets a
support.Relative: its pose in the frame of the body, which replaces the pose for the collision and for all nodes that
read the contact. Contacts of organs get the supports of their bodies, and an energy balance that of its body. The graph
without these keys is unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.engine.faults import Faults, Location, choices
from palpate.launch.load.checks.graph_lines import Line, lines_of, names_in, put_line, touches_itself
from palpate.launch.load.checks.islands import USES, check_size, islands_of
from palpate.launch.load.files import FOUNDATIONS, MOTIONS
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Contact, Contacts, Force, Friction, Ledger, Load, Message, Pose, Proximity, Surface
from palpate.messages.contact import OrganContact
from palpate.messages.wording import written
from palpate.nodes.base.carrier import Carrier

KINDS = {MOTIONS: "support.Moving", FOUNDATIONS: "support.Foundation"}
TURNS = {"rotation", "turns"}  # settings of a motion that rotates organs
UNTOUCHED = "support.OrganFoundation"  # of an organ that no finger touches
EXAMPLES = {
    MOTIONS: "`motions: {breathing: {moves: [tissue], amplitude: [0, 11 mm, 0], period: 4 s, waveform: breathing}}`",
    FOUNDATIONS: "`foundations: {foundation: {moves: [tissue], mass: 150 g, stiffness: 100 N/m, attached: false}}`",
}
Frames = frozenset[str | None]
"""Motions of the organs that a contact belongs to; None: an organ that does not move."""


def add_motions(graph: YamlSource, scene: YamlSource, faults: Faults) -> list[str]:
    """Add the motions and foundations of a scene to a graph. Returns notes."""
    nodes = graph.data.get("nodes")
    given = {key: scene.data.get(key) for key in KINDS}
    for key in KINDS:
        if given[key] in (None, {}):
            scene.data.pop(key, None)
    if not any(given.values()) or not isinstance(nodes, dict):
        return []
    lines = {line.name: line for line in lines_of(nodes)}
    moved: dict[str, str] = {}
    for key, named in given.items():
        if named and not isinstance(named, dict):
            text = f"{key}: found {written(named)}, expected a mapping of names to {key}"
            faults.add(text, EXAMPLES[key], scene.place(key))
            continue
        for name, motion in (named or {}).items():
            _add_motion(key, name, motion, moved, lines, graph, scene.place(key, name), faults)
    return list(_Wiring(graph, lines, moved, scene).connect(faults)) if moved else []


def _add_motion(
    key: str, name: str, motion: Any, moved: dict[str, str], lines: Mapping[str, Line], graph: YamlSource,
    place: Location, faults: Faults,
) -> None:  # fmt: skip
    """Add a motion or foundation to a graph, and to `moved` for each of its bodies."""
    nodes = graph.data["nodes"]
    if _use(nodes.get(name)) in (KINDS[key], UNTOUCHED):
        return  # the graph of a recording has the lines already
    if name in nodes:
        faults.add(f"{key}: {name!r} is the name of a node", f"Another name in {key!r}.", place)
        return
    for body in _bodies(key, name, motion, lines, place, faults):
        if moved.setdefault(body, name) != name:
            faults.add(f"{key}: {body!r} is moved by {moved[body]!r} and {name!r}", "One motion or foundation for each "
                       "body: a motion has both a wave and a `path`.", place)  # fmt: skip
    if key == MOTIONS:  # a foundation follows all that holds its last message, see `_Wiring.connect`
        put_line(graph, name, {"use": KINDS[key], "with": f"${key}.{name}"}, place)


def _use(line: Any) -> Any:
    return line.get("use") if isinstance(line, dict) else None


def _bodies(
    key: str, name: str, motion: Any, lines: Mapping[str, Line], place: Location, faults: Faults
) -> Iterator[str]:
    """The bodies that a motion or foundation moves. A fault for each that the graph lacks, and for several on one."""
    moves = motion.get("moves") if isinstance(motion, dict) else None
    if not (isinstance(moves, list) and moves):
        faults.add(f"{key}: {name!r} has no list `moves`", EXAMPLES[key], place)
        return
    if key == FOUNDATIONS and len(moves) > 1:
        faults.add(f"{key}: {name!r} moves {len(moves)} organs, expected 1", "A foundation for each organ.", place)
        return
    known = [each.name for each in lines.values() if each.sends(Surface) and not each.sends(Contact)]
    for body in moves:
        if body in known:
            yield body
        else:
            text = f"{key}: {name!r} moves {written(body)}, which is no body of the graph"
            faults.add(text, choices("Bodies", str(body), known), place)


def _renamed(value: Any, old: str, new: str) -> Any:
    """A sender as written, with another node."""
    if isinstance(value, dict):
        return value | {"from": _renamed(value.get("from"), old, new)}
    head, dot, stream = value.partition(".") if isinstance(value, str) else ("", "", "")
    return new + dot + stream if head == old else value


class _Wiring:
    """Connects motions and foundations to a graph. moved: the motion or foundation of each body that moves."""

    def __init__(self, graph: YamlSource, lines: dict[str, Line], moved: dict[str, str], scene: YamlSource) -> None:
        self.graph, self.lines, self.moved = graph, lines, moved
        self.foundations = set(scene.data.get(FOUNDATIONS) or ()).intersection(moved.values())
        rotated = {
            name for name, motion in (scene.data.get(MOTIONS) or {}).items()
            if isinstance(motion, dict) and TURNS.intersection(motion)
        }  # fmt: skip
        self.turning = self.foundations | rotated.intersection(moved.values())
        self.place = scene.place(MOTIONS if scene.data.get(MOTIONS) else FOUNDATIONS)
        self._frames: dict[str, Frames] = {}

    def connect(self, faults: Faults) -> Iterator[str]:
        """Change the inputs of all nodes that touch a moved body, and give the foundations theirs. Yields notes."""
        for name in self.lines:
            self.frames(name)  # of the graph as written
        coupled = self._couple(faults)
        for line in self.lines.values():
            if line.sends(Proximity):
                frames = self._of_collision(line)
                if len(frames) > 1:
                    faults.add(f"{line.name!r} collides with organs that move differently",
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
                if line.sends(Force) and frames & self.turning:
                    self._turn_force(line, str(*frames))
            if line.sends(Contact) and line.senders(Contact):
                self._add_in_world(line)
            if line.sends(OrganContact) and line.name not in coupled and not touches_itself(line.cls):
                self._support_sides(line)
            if line.sends(Ledger):
                for motion in {self.moved.get(self._origin(body)) for body in names_in(line.given("body"))} - {None}:
                    self._set(line, "support", self._support(str(motion)))
        for body, name in self.moved.items():
            if name in self.foundations:
                self._add_foundation(name, body, faults)

    def _support(self, motion: str) -> Any:
        """The sender of a motion as written: that of a foundation is the answer to the contacts of the last step."""
        return {"from": motion, "loop": True} if motion in self.foundations else motion

    def _add_foundation(self, foundation: str, body: str, faults: Faults) -> None:
        """Connect a foundation with the contacts of its body: of fingers, with their friction, in the order of the
        loads, and of other organs."""
        contacts: list[str] = []
        frictions: list[str] = []
        poses: list[Any] = []
        organs: list[str] = []
        for load in self.lines[body].senders(Load):
            line = self.lines.get(self._origin(load))
            contact, touching = (line.senders(kind) if line else [] for kind in (Contact, OrganContact))
            if any(name in self.lines and touches_itself(self.lines[name].cls) for name in touching):
                continue  # its forces on the organ are in equilibrium
            if line is None or not (contact or touching):
                faults.add(f"{FOUNDATIONS}: {foundation!r} moves {body!r}, on which {load!r} presses, which is neither "
                           "a finger nor a contact of organs",
                           "Without this organ in `moves`, or a motion of `motions`.", self.place)  # fmt: skip
                return
            organs += touching
            contacts += contact
            frictions += line.senders(Friction)
            poses += self._poses(contact[0]) if contact else []
        given: dict[str, Any] = {"contact": contacts, "friction": frictions, "pose": poses, "body": body}
        if organs:
            given = (given if contacts else {"body": body}) | {"organs": organs}
        use = KINDS[FOUNDATIONS] if contacts or not organs else UNTOUCHED
        put_line(self.graph, foundation, {"use": use, "in": given, "with": f"${FOUNDATIONS}.{foundation}"}, self.place)

    def _poses(self, contact: str) -> list[Any]:
        """The pose, as written, that the collision of a contact reads: in the frame of its organ."""
        near = self.lines[self._origin(contact)].senders(Proximity) if self._origin(contact) in self.lines else []
        collisions = [self.lines[self._origin(name)] for name in near[:1] if self._origin(name) in self.lines]
        return [line.given(port) for line in collisions for port in line.ports(Pose)[:1]]

    def _turn_force(self, line: Line, foundation: str) -> None:
        """Give the readers of a force in the frame of an organ that rotates, except energy balances, that of the
        world."""
        name = f"{line.name}-world"
        given = {"force": line.name, "support": self._support(foundation)}
        put_line(self.graph, name, {"use": "support.Absolute", "in": given}, self.place)
        for reader in self.lines.values():
            if reader.sends(Ledger):
                continue
            for port, given in list((reader.data.get("in") or {}).items()):
                several = given if isinstance(given, list) else [given]
                if line.name in names_in(several):
                    seen = [_renamed(one, line.name, name) for one in several]
                    self._set(reader, port, seen if isinstance(given, list) else seen[0])

    def _add_in_world(self, line: Line) -> None:
        """Give a node that adds contacts of organs which rotate differently each of them, with its friction, in the
        axes of the world."""
        frames = {name: self.frames(name) for name in line.senders(Contact)}
        if len(frozenset().union(*frames.values())) < 2:
            return
        for kind in (Contact, Friction):
            for port in line.ports(kind):
                given = line.given(port)
                several = given if isinstance(given, list) else [given]
                seen = [self._in_world(one, kind, frames) for one in several]
                self._set(line, port, seen if isinstance(given, list) else seen[0])

    def _in_world(self, sender: Any, kind: type[Message], frames: dict[str, Frames]) -> Any:
        """The node that turns a contact or its friction, a sender as written, into the world; itself if its organ does
        not rotate."""
        name = next(iter(names_in([sender])), "")
        rubbed = self.lines.get(self._origin(name)) if kind is Friction else None
        contact = next(iter(rubbed.senders(Contact)), "") if rubbed else name
        motion = next(iter(frames.get(contact, {None})))
        if motion not in self.turning:
            return sender
        turned = f"{contact}-world"
        data = self.graph.data["nodes"].get(turned)
        if data is None:
            given = {"contact": contact, "support": self._support(str(motion))}
            put_line(self.graph, turned, {"use": "support.World", "in": given}, self.place)
        if kind is Friction:
            self.graph.put(("nodes", turned, "in", "friction"), YamlSource(sender, {(): self.place}))
        return turned

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

    def _of_collision(self, line: Line) -> Frames:
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
            name = next(iter(names_in(self.lines[name].given("message"))), name)
        return name

    def _see_from(self, line: Line, motion: str | None) -> None:
        """Replace the poses that a node reads by those in the frame of a motion."""
        for port in line.ports(Pose):
            given = line.given(port)
            seen = [self._relative(one, str(motion)) for one in (given if isinstance(given, list) else [given]) if one]
            if seen:
                self._set(line, port, seen if isinstance(given, list) else seen[0])

    def _relative(self, pose: Any, motion: str) -> str:
        """The node that sends a pose, as written, in the frame of a motion."""
        name = f"{names_in(pose)[0]}-{motion}"
        if name not in self.graph.data["nodes"]:
            line = {"use": "support.Relative", "in": {"pose": pose, "support": self._support(motion)}}
            put_line(self.graph, name, line, self.place)
        return name

    def _support_sides(self, line: Line) -> None:
        """Give a contact of organs the motions of its bodies."""
        for side, body in self._sides(line):
            if body in self.moved:
                self._set(line, f"{side}_support", self._support(self.moved[body]))

    def _sides(self, line: Line) -> Iterator[tuple[str, str]]:
        """Each body of a contact of organs, with its side."""
        for side in self.lines.values():
            if side.sends(Load) and line.name in side.senders(OrganContact):
                for body in self.lines.values():
                    if side.name in body.senders(Load) and not body.sends(OrganContact):
                        yield side.data.get("side", "first"), body.name

    def _comes_from(self, load: str, contacts: list[str]) -> bool:
        """Whether a load is that of one of these contacts of organs."""
        line = self.lines.get(self._origin(load))
        return bool(line and set(line.senders(OrganContact)) & set(contacts))

    def _couple(self, faults: Faults) -> set[str]:
        """Solve contacts together that share organs on foundations. Returns their names."""
        floating = {body for body, name in self.moved.items() if name in self.foundations}
        contacts = {
            line.name: [body for _, body in self._sides(line)]
            for line in self.lines.values() if line.sends(OrganContact) and line.data["use"] in USES
        }  # fmt: skip
        found = islands_of(contacts, floating)
        for island in found:
            moving = [self.moved[body] for name in island for body in contacts[name] if body in self.moved]
            touched = {body for name in island for body in contacts[name]}
            loads = list(dict.fromkeys(
                load for body in self.lines for load in self.lines[body].senders(Load)
                if body in touched and not self._comes_from(load, island)
            ))  # fmt: skip
            check_size(island, loads, self.place, faults)
            for name in island:
                self.graph.put(("nodes", name, "use"), YamlSource(USES[1], {(): self.place}))
                self._set(self.lines[name], "loads", loads)
                self._set(self.lines[name], "supports", [self._support(each) for each in dict.fromkeys(moving)])
        return {name for island in found for name in island}

    def _set(self, line: Line, port: str, sender: Any) -> None:
        self.graph.put(("nodes", line.name, "in", port), YamlSource(sender, {(): self.place}))
