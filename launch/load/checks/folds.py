"""The scene's key `folds`: organs that touch themselves, where walls of a cut, a fissure or a fold close under a load.

    folds:
      tissue: {reach: 4 mm}

Each body gets a contact.Folds with two contact.Wall, whose loads are its last; contacts of fingers and of other organs
with it, and energy balances, get their messages. The graph without this key is unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.engine.faults import Faults, Location, choices
from palpate.launch.load.checks.graph_lines import Line, lines_of, names_in, put_line
from palpate.launch.load.contact_paths import MESH
from palpate.launch.load.files import FOLDS
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Contact, Contacts, Ledger, Load, Surface
from palpate.messages.contact import SIDES, Neighbour, OrganContact
from palpate.messages.wording import written

USE, WALL = "contact.Folds", "contact.Wall"
FEELS = {"contact.Series": "contact.Backed"}
"""Contact of a finger that feels no neighbours, and the one in its place."""
EXAMPLE = "`folds: {tissue: {reach: 4 mm}}`"


def add_folds(graph: YamlSource, scene: YamlSource, faults: Faults) -> None:
    """Add the contacts of organs with themselves of a scene to a graph."""
    nodes, given, place = graph.data.get("nodes"), scene.data.get(FOLDS), scene.place(FOLDS)
    if given in (None, {}):
        scene.data.pop(FOLDS, None)
        return
    if not isinstance(nodes, dict):
        return
    if not isinstance(given, dict):
        text = f"{FOLDS}: found {written(given)}, expected a mapping of bodies to settings"
        faults.add(text, EXAMPLE, place)
        return
    lines = {line.name: line for line in lines_of(nodes)}
    known = [line.name for line in lines.values() if line.sends(Surface) and line.ports(Load)]
    for body, settings in given.items():
        name, at = f"folds-{body}", scene.place(FOLDS, body)
        if body not in known:
            text = f"{FOLDS}: {written(body)} is no body of the graph"
            faults.add(text, choices("Bodies", str(body), known), at)
        elif not isinstance(settings, dict):
            text = f"{FOLDS}: found {written(settings)} for {body!r}, expected a mapping of settings, such as {{}}"
            faults.add(text, EXAMPLE, at)
        elif name not in nodes:
            _add(name, lines[body], lines, graph, at)
        elif not (isinstance(nodes[name], dict) and nodes[name].get("use") == USE):
            faults.add(f"{FOLDS}: {name!r} is the name of another node", "Rename that node.", at)
        # else the graph of a recording, which has the lines already


def _add(name: str, body: Line, lines: Mapping[str, Line], graph: YamlSource, place: Location) -> None:
    """Add the contact of a body with itself, and connect it."""
    port = body.ports(Load)[0]
    loads, walls = _listed(body.given(port)), [f"{side}-wall-{body.name}" for side in SIDES]
    organs = [load for load in loads if any(lines[n].ports(OrganContact) for n in names_in(load) if n in lines)]
    first = [load for load in loads if load not in organs] or organs
    given = {"first": first, "second": [load for load in loads if load not in first]}
    put_line(graph, name, {"use": USE, "in": given, "with": f"${FOLDS}.{body.name}"}, place)
    surface = {key: body.data[key] for key in ("with", *MESH) if key in body.data}
    for side, wall in zip(SIDES, walls, strict=True):
        put_line(graph, wall, {"use": WALL, "in": {"contact": name}, "side": side, **surface}, place)
    for line in lines.values():
        if line is body:
            _append(graph, line, port, walls, place)
        elif line.sends(OrganContact):
            for side in _sides(line, body, lines):
                _append(graph, line, side, walls, place)
        elif line.sends(Contact, Contacts) and body.name in line.senders(Surface):
            if line.data["use"] in FEELS:
                graph.put(("nodes", line.name, "use"), YamlSource(FEELS[line.data["use"]], {(): place}))
                _append(graph, line, "neighbour", walls, place)
            for felt in line.ports(Neighbour):
                _append(graph, line, felt, walls, place)
        elif line.sends(Ledger) and body.name in line.senders(Surface):
            _append(graph, line, "between", [name], place)


def _sides(contact: Line, body: Line, lines: Mapping[str, Line]) -> list[str]:
    """The sides of a contact of organs whose loads act on a body."""
    loads = [lines[load] for load in body.senders(Load) if load in lines]
    return [str(load.data.get("side", SIDES[0])) for load in loads if contact.name in load.senders(OrganContact)]


def _append(graph: YamlSource, line: Line, port: str, senders: list[str], place: Location) -> None:
    given = [*_listed(line.given(port)), *senders]
    graph.put(("nodes", line.name, "in", port), YamlSource(given, {(): place}))


def _listed(given: Any) -> list[Any]:
    if given is None:
        return []
    return list(given) if isinstance(given, list) else [given]
