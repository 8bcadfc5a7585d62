"""The organs of a scene: a list of files, labels of segmentations or built-in surfaces, with place and tissue.

organs:
  - {name: liver, file: liver.stl, unit: mm, position: [0, 0, 0.128], tissue: liver-human}
  - {name: kidney, file: seg.nii.gz, label: 2}       # labels of one segmentation keep their places
  - {file: seg.nii.gz, label: prostate+tumour}       # the second label is a nodule inside of the first
  - {file: seg.nii.gz, label: liver/rib_left_9}      # the second label is rigid bone next to the first
  - {surface: sphere, name: ball, position: [0, 0, 0.084], tissue: {young: 40 kPa}}
"""

from __future__ import annotations

import re
from typing import Any

from palpate.engine.faults import Fault, Faults, GraphError, choices
from palpate.launch.load.labelled.bone import RigidBone
from palpate.launch.load.labelled.nodule import Nodule
from palpate.launch.load.labelled.table import tissue_of
from palpate.launch.load.organ_file import Labelled, organ_of
from palpate.launch.load.several.reach import placed_mesh
from palpate.launch.load.tissues import fill_in
from palpate.launch.load.values.source import YamlSource, merge
from palpate.messages.wording import written
from palpate.physics.errors import PalpateError
from palpate.physics.segmentation.endings import JOIN, ON

ORGANS = "organs"  # key of a scene
FILE = ("file", "unit", "piece", "label")
PLACE = ("position", "rotation", "vertices", "refine")
KEYS = ("name", "surface", *FILE, *PLACE, "tissue")
MOST = 16

Parts = dict[str, list[Nodule | RigidBone]]


def take_organs(scene: YamlSource, faults: Faults) -> tuple[list[str] | None, tuple[str, ...], Parts]:
    """Replace the list of organs in a scene by a part for each, named like the organ, with its `surface`, over that of
    the scene, and its `tissue`, without one that of the scene. Returns the names in the order of the list, None without
    a list, what was changed for segmentations, and nodules and bone of organs by their names.

    A fault for each entry that cannot be used.
    """
    given = scene.data.get(ORGANS)
    if given is None:
        return None, (), {}
    place = scene.place(ORGANS)
    if not (isinstance(given, list) and 1 <= len(given) <= MOST):
        faults.add(f"organs: found {written(given)}, expected a list of 1 to {MOST} organs", "", place)
        return None, (), {}
    entries = [YamlSource(entry, _places(scene, number)) for number, entry in enumerate(given)]
    scene.drop((ORGANS,))
    del scene.data[ORGANS]
    names: list[str] = []
    notes: list[str] = []
    parts: Parts = {}
    for entry in entries:
        read = faults.keep(_read, entry, scene, names)
        if read is not None:
            name, part, made, found = read
            scene.put((name,), part)
            parts[name] = found
            names.append(name)
            notes += made
    return names, tuple(notes), parts


def add_parts(parts: Parts, scene: YamlSource, faults: Faults) -> tuple[str, ...]:
    """Put nodules and bone of organs into their tissues, where these do not set them, at the places that the organs
    have now. Returns notes; a fault for each nodule that cannot be in its organ."""
    notes: list[str] = []
    for name, part in [(name, part) for name, found in parts.items() for part in found]:
        mesh, rotation, position = placed_mesh(scene.data[name].get("surface"))
        if mesh is None:
            continue  # the nodes report why
        try:
            found, more = part.settings(mesh, rotation, position)
        except PalpateError as error:
            faults.add(f"organs: {error}", "", scene.place(name))
            continue
        notes += more
        for key, value in found.items():
            if key not in scene.data[name]["tissue"]:
                scene.put((name, "tissue", key), YamlSource(value, {(): scene.place(name)}))
    return tuple(notes)


def _places(scene: YamlSource, number: int) -> dict[tuple[Any, ...], Any]:
    head = (ORGANS, number)
    found = {keys[2:]: place for keys, place in scene.places.items() if keys[:2] == head}
    return {(): scene.place(*head)} | found


def _read(
    entry: YamlSource, scene: YamlSource, names: list[str]
) -> tuple[str, YamlSource, tuple[str, ...], list[Nodule | RigidBone]]:
    """Name, part of the scene, notes, and nodule and bone of one organ. GraphError: it cannot be used."""
    data, place = entry.data, entry.place()
    if not isinstance(data, dict):
        raise GraphError([Fault(f"organs: found {written(data)}, expected {{file: liver.stl, unit: mm}}", "", place)])
    for key in data:
        if key not in KEYS:
            raise GraphError([Fault(f"organs: found the key {key!r}", choices("Keys", key, KEYS), entry.place(key))])
    if ("file" in data) == ("surface" in data):
        raise GraphError([Fault("organs: expected either `file` or `surface` of each organ", "", place)])
    surface: dict[str, Any] = {"spacing": 0}  # a contact of organs needs all vertices
    notes: tuple[str, ...] = ()
    labelled, stem = Labelled(), data.get("surface")
    if "file" in data:
        organ = organ_of({key: data[key] for key in FILE if key in data}, entry.place("file"))
        stem = str(data.get("label") or organ.stem).split(ON)[0].split(JOIN)[0].strip()
        try:
            organ.check()
            labelled = organ.labelled()
            organ, notes = organ.as_mesh()
            surface |= {"surface": str(organ.file.absolute()), "file_unit": organ.in_unit(), "piece": organ.setting}
        except PalpateError as error:
            raise GraphError([Fault(str(error).replace("--organ ", ""), "", entry.place("file"))]) from None
    else:
        surface["surface"] = stem
    name = data.get("name", re.sub(r"[^A-Za-z0-9_-]+", "-", str(stem)))
    if not (isinstance(name, str) and re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name)):
        text = f"organs: found the name {written(name)}, expected letters, digits, _ and -"
        raise GraphError([Fault(text, "`name: liver`", entry.place("name"))])
    if name in names or name in scene.data:
        what = "an organ" if name in names else "a part of the scene"
        raise GraphError([Fault(f"organs: {what} has the name {name!r}", "Give it another `name`.", place)])
    surface |= {key: data[key] for key in PLACE if key in data}
    if "tissue" not in data and (tissue := tissue_of(labelled.name)):
        entry.put(("tissue",), YamlSource(tissue, {(): place}))
        notes = (*notes, f"organs: {name} has the tissue {tissue}, for its label {labelled.name}; `tissue:` changes it")
    fill_in(entry, "tissue")
    part = YamlSource({}, {(): place})
    part.put(("surface",), YamlSource(surface, {(): place} | {(key,): entry.place(key) for key in surface}))
    if isinstance(scene.data.get("surface"), dict):
        part.put(("surface",), merge(scene.sub("surface"), part.sub("surface")))
    part.put(("tissue",), entry.sub("tissue") if "tissue" in data else scene.sub("tissue"))
    if not isinstance(part.data["tissue"], dict):
        text = f"organs: found the tissue {written(data.get('tissue'))} of {name}, expected a name or a mapping"
        raise GraphError([Fault(text, "`tissue: liver-human`, or {young: 19 kPa}", entry.place("tissue"))])
    return name, part, notes, labelled.parts
