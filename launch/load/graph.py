"""Loads a graph: reads, resolves and checks everything before anything starts.

`load` returns a `Graph` whose nodes have their classes, settings and edges, or raises GraphError with all faults.
"""

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from palpate.engine.faults import Faults, Location, choices
from palpate.engine.graph import Edge, Graph, NodeSpec, streams_of
from palpate.launch.load.checks.agreeing import agree
from palpate.launch.load.checks.carried import add_motions
from palpate.launch.load.checks.floating import place_fingers
from palpate.launch.load.checks.folds import add_folds
from palpate.launch.load.checks.ideal import remove_imperfections
from palpate.launch.load.checks.islands import place_islands
from palpate.launch.load.checks.overlapping import overlaps
from palpate.launch.load.checks.several_organs import share_organs
from palpate.launch.load.checks.touching import place_bodies
from palpate.launch.load.classes import ClassError, body, find_class
from palpate.launch.load.contact_paths import ContactPaths, check_divisors, shares_without_body, unlike_surfaces
from palpate.launch.load.effects import KEY as EFFECTS
from palpate.launch.load.effects import apply as switch
from palpate.launch.load.effects import choose_effects as chosen_effects
from palpate.launch.load.files import GRAPHS, ORGAN, Override, apply, find_file, read_extended, read_scene
from palpate.launch.load.network import device_delays, unknown_delays, unlike_delays
from palpate.launch.load.plan import missing_senders
from palpate.launch.load.resting import restless
from palpate.launch.load.scene import Scene, condition
from palpate.launch.load.several.described import add_parts, take_organs
from palpate.launch.load.several.lines import has_marks, repeat_lines
from palpate.launch.load.several.reach import pairs_in_reach
from palpate.launch.load.values.lines import BOOLEAN, fill, quantity
from palpate.launch.load.values.settings import Offer, calibration_notes, check_offers, check_taken, resolve
from palpate.launch.load.values.source import YamlSource
from palpate.launch.load.wiring import Kinds, Wire, close_loops, find_streams, unknown, wires, wires_of
from palpate.messages import Message
from palpate.messages.wording import written
from palpate.nodes.base import Node, Observer, inputs, settings
from palpate.nodes.base.carrier import Carrier

RESERVED = ("scene", "rate", "wanted", EFFECTS, "all")
EMULATOR = "emulator"  # the `port` of an emulated device
MOST = 1_000_000  # largest divisor `every`


class _GraphFile(msgspec.Struct, kw_only=True):
    """The contents of a graph file. Fields of type Any are checked where they are used."""

    scene: Any = None
    rate: Annotated[float, quantity("Hz", 1e-3, 1e6)] = 1000.0
    nodes: Annotated[dict[str, Any], msgspec.Meta(min_length=1, description="a mapping of names to nodes")]
    wanted: Any = None
    effects: Any = None
    extends: Any = None
    run: Any = None


class _NodeLine(msgspec.Struct, rename={"inputs": "in", "offered": "with"}):
    """The keys of a node's line that are not settings of its class."""

    use: Annotated[str, msgspec.Meta(description="module.Class such as contact.Series")]
    inputs: Any = None
    offered: Any = None
    when: Any = None
    every: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=MOST)] | None, msgspec.Meta(description=f"a whole number from 1 to {MOST}")
    ] = None
    restart: Annotated[bool | None, msgspec.Meta(description="true or false")] = None


LINE = tuple(field.encode_name for field in msgspec.structs.fields(_NodeLine))


@dataclass
class _Draft:
    """A node while the graph is being read. `set_keys`: the keys of its line that may be settings."""

    line: YamlSource
    keys: _NodeLine
    cls: type[Node]
    set_keys: list[str]
    wires: list[Wire] = field(default_factory=list)


def load(
    path: str | Path,
    *,
    overrides: Sequence[str | Override] = (),
    scene: str | Path | Mapping[str, Any] | None = None,
    wanted: Sequence[str] | None = None,
    source: YamlSource | None = None,
) -> Graph:
    """Read and check a graph.

    path       YAML file, or name of a shipped graph; the name of `source` if that is given
    overrides  `target=value` each; later ones win
    scene      file, name or mapping that replaces the scene of the graph
    wanted     streams to compute, instead of those of scene or graph; an override of `wanted` takes precedence
    source     contents of the file, if already read

    GraphError: all faults.
    """
    # Read the file, its scene and the overrides.
    if source is None:
        path = find_file(str(path), GRAPHS, what="graph")
        source = read_extended(path, GRAPHS)
    faults = Faults()
    scene_source = read_scene(scene, source, faults)
    parsed = [faults.keep(Override.parse, item) if isinstance(item, str) else item for item in overrides]
    changes = [item for item in parsed if item is not None]
    notes, apart = _repeat_for_organs(changes, source, scene_source, faults)
    switched = chosen_effects(source, scene_source, faults)
    place = scene_source.place(ORGAN)
    organ = None if (given := scene_source.data.pop(ORGAN, None)) is None else (given, place)
    world = Scene(scene_source)
    contents = fill(_GraphFile, source, faults) or _GraphFile(nodes={})
    # Find the classes of the nodes; `unclear` are those without one, which cause no further faults.
    drafts, unclear = _drafts(contents.nodes, source, faults)
    unclear |= _resolve_carriers(drafts, faults)
    # Resolve settings and inputs of each node; check the values and the force path.
    kinds = {name: streams_of(name, draft.cls) for name, draft in drafts.items() if name not in unclear}
    offers: list[Offer] = []
    nodes = _nodes(drafts, kinds, unclear, world, offers, faults)
    for name in apart.keys() & nodes.keys():
        nodes[name].off = apart[name]
    remove_imperfections(world, nodes, offers, changes, faults)
    connections = _connect(drafts, nodes, faults)
    notes += [] if unclear else _check_values(drafts, nodes, offers, changes, world, faults)
    switch(switched, nodes, faults)
    by_value = () if unclear else _check_force_path(drafts, nodes, offers, connections, contents.rate, faults)
    notes += [] if unclear or faults.entries else _instead(nodes, drafts, world, faults)
    # Choose the wanted streams.
    holder = source
    if not any(change.keys == ("wanted",) for change in changes):
        if wanted is not None:
            holder = YamlSource({"wanted": list(wanted)}, {(): Location("wanted")})
        elif scene_source.data.get("wanted") is not None:
            holder = scene_source
    found_wanted = _parse_wanted(holder, kinds, unclear, faults)
    notes += _half_emulated(nodes)
    recorded = {key: value for key, value in source.data.items() if key not in ("scene", "run")}
    graph = Graph(
        Path(path), contents.rate, world.data, nodes, found_wanted, recorded, switched, tuple(notes), organ, by_value
    )
    faults.entries.extend(missing_senders(graph))
    faults.done()
    return graph


def _repeat_for_organs(
    changes: list[Override], source: YamlSource, scene: YamlSource, faults: Faults
) -> tuple[list[str], dict[str, str]]:
    """Apply the overrides, those of the scene first: on it depends which lines are repeated for which organs, and which
    organs move. Notes, and why nodes of pairs out of reach do not run."""
    before = len(faults.entries)
    organs, notes, parts = take_organs(scene, faults)
    several, unread = has_marks(source), len(faults.entries) > before
    of_scene = [change for change in changes if change.keys[0] == "scene" and len(change.keys) > 1]
    apply(of_scene, source, scene, faults)
    notes = (*notes, *add_parts(parts, scene, faults))
    pairs, apart = pairs_in_reach(organs or [], scene, faults) if several else ([], {})
    off = repeat_lines(source, organs, pairs, apart, faults)
    if several and unread:
        faults.done()  # without all lines of the graph, others would lack senders and fields
    add_folds(source, scene, faults)
    notes = (*notes, *add_motions(source, scene, faults))
    apply([change for change in changes if change not in of_scene], source, scene, faults)
    if organs and not several:
        notes = (*notes, "the scene's list `organs` reaches no node: the graph has no line such as contact-<organ>")
    return list(notes), off


def _nodes(
    drafts: dict[str, _Draft], kinds: Kinds, unclear: set[str], world: Scene, offers: list[Offer], faults: Faults
) -> dict[str, NodeSpec]:
    """The nodes with their settings; the inputs of each are added to its draft, the values that the scene offers it to
    `offers`."""
    nodes: dict[str, NodeSpec] = {}
    for name, draft in drafts.items():
        nodes[name] = _node(name, draft, world, offers, faults)
        if nodes[name].observer:
            nodes[name].listen = _listen(name, draft.line, kinds, unclear, faults)
            _check_fields(nodes[name], draft.line, kinds, unclear, faults)
        else:
            draft.wires = wires(name, draft.cls, draft.line, kinds, unclear, faults)
    return nodes


def _connect(drafts: dict[str, _Draft], nodes: dict[str, NodeSpec], faults: Faults) -> list[Wire]:
    """All connections; chooses the held edges that break loops, and adds its edges to each node."""
    connections = [wire for draft in drafts.values() for wire in draft.wires]
    close_loops(connections, list(drafts), faults)
    for name, draft in drafts.items():
        nodes[name].edges = tuple(Edge(w.port.name, w.producer, w.stream, w.held) for w in draft.wires)
    return connections


def _check_values(
    drafts: dict[str, _Draft],
    nodes: dict[str, NodeSpec],
    offers: list[Offer],
    changes: Sequence[Override],
    world: Scene,
    faults: Faults,
) -> list[str]:
    """Check that each value of the scene is used. Notes on unused and uncalibrated ones."""
    check_offers(offers, world, faults)
    scene_changes = [(".".join(c.keys[1:]), c.value) for c in changes if c.keys[0] == "scene"]
    notes, offered = list(check_taken(offers, scene_changes, world, faults)), _by_node(offers)
    for name, draft in drafts.items():
        if nodes[name].off is None:
            notes += calibration_notes(name, draft.cls, draft.set_keys, offered.get(name, ()))
    return notes


def _by_node(offers: Sequence[Offer]) -> dict[str, list[Offer]]:
    found: dict[str, list[Offer]] = {}
    for offer in offers:
        found.setdefault(offer.node, []).append(offer)
    return found


def _check_force_path(
    drafts: dict[str, _Draft],
    nodes: dict[str, NodeSpec],
    offers: list[Offer],
    connections: list[Wire],
    rate: float,
    faults: Faults,
) -> tuple[str, ...]:
    """Check contacts, bodies, controllers, divisors and delays; settings that several nodes share get one value. Notes
    on values of the settings."""
    may = {name: spec for name, spec in nodes.items() if spec.off is None and not spec.observer}
    contacts = ContactPaths({n: s.cls for n, s in may.items()}, connections)
    contacts.place_shares(may, faults)
    contacts.place_driven(may)
    contacts.check({n: s.place for n, s in may.items()}, faults)
    check_divisors(may, connections, faults)
    offered = _by_node(offers)
    places = {
        name: {offer.key: offer.place for offer in offered.get(name, ()) if offer.taken}
        | {key: draft.line.place(key) for key in draft.set_keys}
        for name, draft in drafts.items()
    }
    agree(may, connections, places, faults)
    place_bodies(may, connections, faults)
    place_islands(may, connections)
    place_fingers(may, connections, faults)
    share_organs(may, connections)
    for balance, delay in device_delays(may, connections, rate):
        if "delay" not in places[balance.name]:
            balance.settings["delay"] = delay
    for each in overlaps(may, connections):
        if each.same:
            faults.add(each.text, each.cure, nodes[each.organ.collision].place, node=each.organ.collision)
    return tuple(value_notes(nodes, rate))


def value_notes(nodes: dict[str, NodeSpec], rate: float) -> Iterator[str]:
    """The notes on a graph that depend on the values of settings of its nodes."""
    may = {name: spec for name, spec in nodes.items() if spec.off is None and not spec.observer}
    connections = list(wires_of(may))
    yield from unlike_surfaces(may, connections)
    yield from shares_without_body(may, connections)
    yield from unknown_delays(may, connections, rate)
    yield from unlike_delays(may, connections, rate)
    yield from restless(may, connections, rate)
    yield from (each.text for each in overlaps(may, connections) if not each.same)


def notes_with(graph: Graph, values: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """The notes on a graph with these settings of its nodes, by name, instead of its settings."""
    nodes = {
        name: replace(spec, settings=dict(values[name])) if name in values else spec
        for name, spec in graph.nodes.items()
    }
    return (*graph.other_notes, *value_notes(nodes, graph.rate))


def _instead(
    nodes: Mapping[str, NodeSpec], drafts: Mapping[str, _Draft], scene: Scene, faults: Faults
) -> Iterator[str]:
    """Give nodes the classes that take the place of theirs (`Node.instead`), with a note for each."""
    for name, spec in nodes.items():
        if spec.off is not None or (other := spec.cls.instead(spec.settings)) is None:
            continue
        use, why = other
        cls, draft = find_class(use), drafts[name]
        more = resolve(name, cls, draft.line, draft.set_keys, scene, [], faults)
        yield f"{name}: {use} in place of {spec.use}, because {why}"
        spec.use, spec.cls, spec.settings = use, cls, more | spec.settings


def _half_emulated(nodes: dict[str, NodeSpec]) -> Iterator[str]:
    """A note if some devices are emulated and others are not."""
    ports = {
        name: spec.settings["port"] for name, spec in nodes.items() if spec.off is None and "port" in spec.settings
    }
    real = [name for name, port in ports.items() if port != EMULATOR]
    if real and len(real) < len(ports):
        cure = " ".join(f"--set {name}.port={EMULATOR}" for name in real)
        yield f"{', '.join(n for n in ports if n not in real)}: emulated; {', '.join(real)}: needs hardware, or {cure}"


def _resolve_carriers(drafts: dict[str, _Draft], faults: Faults) -> set[str]:
    """Give carrier nodes the message type of their sender, also through other carriers; returns those without a known
    sender. A fault for each cycle of carriers."""
    left = {name for name, draft in drafts.items() if issubclass(draft.cls, Carrier)}
    senders = {}
    for name in left:
        given = drafts[name].line.data.get("in")
        sender = given.get("message") if isinstance(given, dict) else None
        senders[name] = sender.get("from") if isinstance(sender, dict) else sender
    kinds = {name: streams_of(name, draft.cls) for name, draft in drafts.items() if name not in left}
    readers: dict[str, list[str]] = {}
    for name in sorted(left):
        if isinstance(sender := senders[name], str):
            readers.setdefault(sender.partition(".")[0], []).append(name)
    resolved = list(kinds)
    for sending in resolved:  # grows by the carriers of its streams
        for name in readers.get(sending, ()):
            streams = find_streams(str(senders[name]), kinds)
            if len(streams) == 1:
                carrier = drafts[name].cls
                assert issubclass(carrier, Carrier)
                drafts[name].cls = carrier.of(kinds[sending][streams[0]])
                kinds[name] = streams_of(name, drafts[name].cls)
                left.discard(name)
                resolved.append(name)
    for name in sorted(left):
        path = [name]
        while isinstance(sender := senders[path[-1]], str) and sender in left and sender not in path:
            path.append(sender)
        if sender == name:
            faults.add(f"forwards only its own messages: {' -> '.join([*path, name][::-1])}",
                       "Give it a sender outside this cycle.", drafts[name].line.place("in"), node=name)  # fmt: skip
    return left


def _drafts(given: dict[str, Any], source: YamlSource, faults: Faults) -> tuple[dict[str, _Draft], set[str]]:
    """The nodes whose classes are found, and the names of the others."""
    drafts: dict[str, _Draft] = {}
    unclear = set()
    for name in given:
        place = source.place("nodes", name)
        line = source.sub("nodes", name)
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name) or name in RESERVED:
            faults.add(f"{name!r} cannot name a node", f"Letters, digits, _ and -; not {', '.join(RESERVED)}.", place)
        if not isinstance(line.data, dict):
            faults.add(f"found {written(line.data)}, expected {{use: module.Class, in: ...}}", "", place, node=name)
            unclear.add(name)
            continue
        keys = {key: value for key, value in line.data.items() if key in LINE}
        line_keys = fill(_NodeLine, YamlSource(keys, line.places), faults, node=name)
        if line_keys is None:
            unclear.add(name)
            continue
        try:
            cls = find_class(line_keys.use, _expected_types(name, given))
        except ClassError as error:
            unclear.add(name)
            faults.add(str(error), error.cure, source.place("nodes", name, "use"), node=name)
            continue
        drafts[name] = _Draft(line, line_keys, cls, [key for key in line.data if key not in LINE])
    return drafts, unclear


def _expected_types(name: str, nodes: dict[str, Any]) -> Iterator[type[Message]]:
    """The message types that other nodes expect of a node; computed only for the error of a missing class."""
    for line in nodes.values():
        given = line.get("in") if isinstance(line, dict) else None
        if not (isinstance(given, dict) and isinstance(line.get("use"), str)):
            continue
        for port_name, value in given.items():
            several = value if isinstance(value, list) else [value]
            named = [one.get("from") if isinstance(one, dict) else one for one in several]
            if name in [str(sender).partition(".")[0] for sender in named]:
                with contextlib.suppress(ClassError):
                    cls = find_class(line["use"])
                    ports = () if issubclass(cls, Observer) else inputs(cls)
                    yield from (p.type for p in ports if p.name == port_name)


def _node(name: str, draft: _Draft, scene: Scene, offers: list[Offer], faults: Faults) -> NodeSpec:
    line = draft.line
    when = draft.keys.when
    off = None if when is None else condition(when, scene, faults, line.place("when"), name)
    known = settings(draft.cls)
    for key in draft.set_keys:
        if key not in known:
            text, cure = unknown(line.place(key), f"{key}: null")
            close, keys = choices(f"Settings of {draft.cls.__name__}", key, known), choices("Keys", key, LINE)
            named = {"setting": key}
            if keys.startswith("Did you mean") and not close.startswith("Did you mean"):
                text, close, named = f"unknown key {key!r}", f"{keys} {close}", {}
            if scene.has(path := f"{name}.{key}"):
                close = f"The scene has it: set scene.{path}."
            faults.add(text, close + cure, line.place(key), node=name, **named)
    values = resolve(name, draft.cls, line, [key for key in draft.set_keys if key in known], scene, offers, faults)
    return NodeSpec(
        name,
        draft.keys.use,
        draft.cls,
        values,
        every=draft.keys.every or 1,
        restart=bool(draft.keys.restart),
        when=None if when is None else str(when),
        off=off,
        place=line.place(),
    )


def _listen(name: str, line: YamlSource, kinds: Kinds, unclear: set[str], faults: Faults) -> tuple[str, ...] | None:
    given = line.data.get("in")
    if given == "all":
        return None
    if not isinstance(given, list):
        faults.add(f"in: found {written(given)}, expected `all` or a list of streams", "", line.place("in"), node=name)
        return ()
    return _streams(given, "in", line, kinds, unclear, faults, name)


def _check_fields(spec: NodeSpec, line: YamlSource, kinds: Kinds, unclear: set[str], faults: Faults) -> None:
    """A fault for each name in the `fields` of a logger that no stream of the graph has."""
    asked = spec.settings.get("fields")
    if unclear or not isinstance(asked, list):
        return
    known = {field for streams in kinds.values() for kind in streams.values() for field in body(kind)}
    for name in sorted(set(asked) - known):
        faults.add(f"no stream of the graph has {name!r}", choices("Fields", name, sorted(known)),
                   line.place("fields"), node=spec.name, setting="fields")  # fmt: skip


def _parse_wanted(holder: YamlSource, kinds: Kinds, unclear: set[str], faults: Faults) -> tuple[str, ...] | None:
    """The wanted streams; None: all, or not given."""
    given = holder.data.get("wanted")
    if given is None or given == "all":
        return None
    if isinstance(given, str):
        given = [given]
    if not isinstance(given, list):
        faults.add(f"wanted: found {written(given)}, expected a list of streams", "", holder.place("wanted"))
        return None
    return _streams(given, "wanted", holder, kinds, unclear, faults, "")


def _streams(
    given: list[Any], key: str, source: YamlSource, kinds: Kinds, unclear: set[str],
    faults: Faults, node: str,
) -> tuple[str, ...]:  # fmt: skip
    selected: dict[str, None] = {}
    for index, item in enumerate(given):
        streams = find_streams(item, kinds) if isinstance(item, str) else []
        if not streams and str(item).partition(".")[0] not in unclear:
            known = [stream for streams_of_node in kinds.values() for stream in streams_of_node]
            place = source.place(key, index)
            cure = BOOLEAN if isinstance(item, bool) else choices("Streams", str(item), known)
            faults.add(f"{key}: there is no stream {written(item)}", cure, place, node=node)
        selected |= dict.fromkeys(streams)
    return tuple(selected)
