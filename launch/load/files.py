"""Finds and reads graph and scene files: `extends:`, scenes, and single values set from outside."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import palpate.graphs
from palpate.engine.faults import NOWHERE, Fault, Faults, GraphError, Location, choices, nearest, short
from palpate.launch.load.tissues import fill_in
from palpate.launch.load.values.source import YamlSource, merge, parse, paths, read
from palpate.messages.wording import written

GRAPHS = Path(next(iter(palpate.graphs.__path__))).resolve()
SCENES = GRAPHS / "scenes"
PLACES = GRAPHS / "place"
ORGAN = "organ"  # key of a scene: a mesh file instead of its organ
MOTIONS, FOUNDATIONS = "motions", "foundations"  # keys of a scene: organs that move (launch/load/checks/carried.py)
FOLDS = "folds"  # key of a scene: organs that touch themselves (launch/load/checks/folds.py)
IDEAL = ("hand", "ideal")  # keys of a scene: hands without imperfections (launch/load/checks/ideal.py)
TOP = ("rate", "wanted")
"""Values without a path that can be overridden."""


def find_file(
    name: str, folder: Path, base: Path | None = None, place: Location = NOWHERE, what: str = "file",
    words: Sequence[str] = (),
) -> Path:  # fmt: skip
    """The file with this name: a path, relative to `base` or the working directory, or a shipped file of `folder`.

    words  other valid values, for the error

    GraphError: not found; lists the shipped files.
    """
    given = Path(os.path.expanduser(name))
    tried = [(base or Path.cwd()) / given, folder / given, folder / f"{name}.yaml"]
    for path in tried:
        if os.path.isfile(path):  # False, not an error, for a name that no file can have
            return path.resolve()
    shipped = [*words, *(p.stem for p in sorted(folder.glob("*.yaml")))]
    cure = f"{choices('Shipped', given.stem, shipped)} Or give the path of a file."
    if name and os.path.isdir(tried[0]):
        raise GraphError([Fault(f"{what} {name!r} is a folder", cure, place)])
    raise GraphError([Fault(f"{what} {name!r} not found, looked in {short(str(base or Path.cwd()))}", cure, place)])


def read_extended(path: Path, folder: Path, inside: tuple[Path, ...] = ()) -> YamlSource:
    """A file merged over the one that it `extends:`, recursively.

    GraphError: a file is missing or not YAML, not a mapping, or extends itself.
    """
    source = read(path)
    if not isinstance(source.data, dict):
        found = "nothing" if source.data is None else written(source.data)
        raise GraphError([Fault(f"found {found}, expected a mapping of keys to values", place=Location(str(path), 1))])
    fill_in(source, *(("tissue",) if folder == SCENES else ("scene", "tissue")))
    return extend(source, path.parent, folder, (*inside, path))


def extend(source: YamlSource, at: Path, folder: Path, inside: tuple[Path, ...] = ()) -> YamlSource:
    """A mapping merged over the file that it `extends:`, a path from the folder `at` or a shipped file of `folder`.

    inside  files that lead here by `extends:`

    GraphError: as of `read_extended`.
    """
    base_name = source.data.pop("extends", None)
    place = source.place("extends")
    if base_name is None:
        return source
    if not isinstance(base_name, str):
        raise GraphError([Fault(f"extends: found {written(base_name)}, expected the name of one file", place=place)])
    base = find_file(base_name, folder, at, place, "extends: file")
    if base in inside:
        chain = " -> ".join(p.name for p in (*inside, base))
        raise GraphError([Fault(f"extends: leads back to itself: {chain}", place=place)])
    return _join(read_extended(base, folder, inside), source)


def _join(base: YamlSource, top: YamlSource) -> YamlSource:
    """Merge `top` over `base`. A scene written in `top` overrides the scene of `base`, or extends another one; a node
    with a new class and new inputs drops its old inputs."""
    scene = top.data.get("scene")
    if isinstance(scene, dict) and "extends" in scene:
        base.data.pop("scene", None)
    elif isinstance(scene, dict) and isinstance(base.data.get("scene"), str):
        base.put(("scene",), _named_scene(base))
    for name, line in _mapping(top.sub("nodes")).items():
        old, new = _mapping(base.sub("nodes", name)), line if isinstance(line, dict) else {}
        before, inputs = old.get("in"), new.get("in")
        if "use" not in new or new["use"] == old.get("use"):
            continue
        _put_class(base, name, top.place("nodes", name, "use"))
        if isinstance(before, dict) and isinstance(inputs, dict):
            for port in before:
                inputs.setdefault(port, None)
    return merge(base, top)


def _named_scene(graph: YamlSource) -> YamlSource:
    """The scene whose file a graph names, relative to the file that names it."""
    place = graph.place("scene")
    return read_extended(find_file(graph.data["scene"], SCENES, Path(place.file).parent, place, "scene"), SCENES)


def _put_class(source: YamlSource, name: str, place: Location) -> None:
    """Mark that a node gets another class at this place, for errors about settings that the new class lacks."""
    for keys in paths(source.sub("nodes", name).data, ("nodes", name)):
        if len(keys) > 2 and keys in source.places:
            source.places[keys] = replace(place, before=str(source.places[keys]))


def _mapping(source: YamlSource) -> dict[str, Any]:
    return source.data if isinstance(source.data, dict) else {}


def read_scene(scene: str | Path | Mapping[str, Any] | None, graph: YamlSource, faults: Faults) -> YamlSource:
    """The scene of a graph: `scene` if given, otherwise the graph's scene, otherwise an empty one.

    If it cannot be read, the graph is checked with the shipped scene of the most similar name. GraphError: no similar
    name.
    """
    named = graph.data.get("scene")
    try:
        if isinstance(scene, Mapping):
            given = YamlSource(dict(scene), {(): Location("the scene given")})
            fill_in(given, "tissue")
            return extend(given, Path.cwd(), SCENES)
        if scene is not None:
            return read_extended(find_file(str(scene), SCENES, what="scene"), SCENES)
        if isinstance(named, str):
            return _named_scene(graph)
        if isinstance(named, dict):
            return extend(graph.sub("scene"), Path(graph.place("scene").file).parent, SCENES)
    except GraphError as error:
        faults.entries.extend(error.faults)
        wrong = named if scene is None else scene
        stem = Path(str(wrong.get("extends") if isinstance(wrong, Mapping) else wrong)).stem
        close = nearest(stem, [path.stem for path in SCENES.glob("*.yaml")], 1)
        if not close:
            faults.done()
        return read_extended(SCENES / f"{close[0]}.yaml", SCENES)
    if named is not None:
        faults.add(f"scene: found {written(named)}, expected a file or a mapping", "", graph.place("scene"))
    return YamlSource({}, {(): graph.place("scene")})


@dataclass(frozen=True)
class Override:
    """One value set from outside: `tissue.stiffness=2e3`, `scene.finger.thickness=3 mm`, `rate=500`.

    keyword  it is an argument of `palpate.run`, whose name is that of a node
    """

    keys: tuple[str, ...]
    value: YamlSource
    keyword: bool = False

    @property
    def place(self) -> Location:
        """Where it was set."""
        return self.value.place()

    @staticmethod
    def parse(text: str) -> Override:
        """From the form `target=value`, the value in YAML. GraphError: no target, no value, or not YAML."""
        target, sign, value = text.partition("=")
        place = Location(f"--set {text}")
        keys = tuple(target.strip().split("."))
        if not sign or not all(keys):
            raise GraphError([Fault("expected target=value, such as tissue.stiffness=2e3", place=place)])
        source = parse(value, place.file)
        return Override(keys, YamlSource(source.data, {(): place}))


def apply(overrides: list[Override], graph: YamlSource, scene: YamlSource, faults: Faults) -> None:
    """Set each value in the graph or the scene; an unknown target is a fault with the nearest name."""
    for override in overrides:
        head, *rest = override.keys
        nodes = graph.data.get("nodes")
        nodes = nodes if isinstance(nodes, dict) else {}
        if head == "scene" and rest:
            _set_scene(override, rest, scene, faults)
        elif head == "effects" and len(rest) == 1:
            given = scene.data.get(head)
            (scene if isinstance(given, dict) and rest[0] in given else graph).put((head, *rest), override.value)
        elif head in TOP and not rest:
            graph.put((head,), override.value)
        elif head in nodes and not rest and override.value.data is None:
            del nodes[head]
        elif head in nodes and (len(rest) == 1 or (len(rest) == 2 and rest[0] == "in")):
            if not isinstance(nodes[head], dict):
                continue
            inputs = nodes[head].get("in")
            if rest == ["use"]:
                _put_class(graph, head, override.place)
            if rest[0] == "in" and override.value.data is None and isinstance(inputs, dict) and rest[-1] in inputs:
                del inputs[rest[-1]]
            else:
                graph.put(("nodes", *override.keys), override.value)
        elif head in nodes:
            faults.add(f"found {'.'.join(override.keys)!r}, expected {head}.setting, {head}.use or {head}.in.input", "",
                       override.place, node=head)  # fmt: skip
        elif override.keyword:
            cure = f"{choices('Nodes', head, nodes)} Anything else goes into sets=['scene.finger.thickness=3 mm']."
            faults.add(f"found {head!r}, expected the name of a node, or effects", cure, override.place)
        else:
            cure = choices("Targets", head, [*nodes, "scene.<path>", "effects.<name>", *TOP])
            text = f"found {head!r}, expected a node, scene.<path>, effects.<name>, rate or wanted"
            faults.add(text, cure, override.place)


def _set_scene(override: Override, rest: list[str], scene: YamlSource, faults: Faults) -> None:
    if rest in ([ORGAN], [MOTIONS], [FOUNDATIONS], [FOLDS]) or tuple(rest) == IDEAL:  # any scene may have these
        scene.put(tuple(rest), override.value)
        return
    data = scene.data
    for depth, key in enumerate(rest):
        if not (isinstance(data, dict) and key in data):
            known = [f"scene.{'.'.join([*rest[:depth], k])}" for k in data] if isinstance(data, dict) else []
            cure = choices("The scene has", ".".join(override.keys), known)
            faults.add(f"the scene has no {'.'.join(rest)!r}", cure, override.place)
            return
        data = data[key]
    if rest == ["tissue"] and isinstance(override.value.data, str):
        taken = YamlSource({"tissue": override.value.data}, {("tissue",): override.place})
        fill_in(taken, "tissue")
        scene.put(("tissue",), merge(scene.sub("tissue"), taken.sub("tissue")))
        return
    scene.put(tuple(rest), override.value)
