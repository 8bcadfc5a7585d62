"""The variants of a page: one run for each scene and organ, each body, each choice of effects, and each hard case."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from palpate.engine.faults import GraphError
from palpate.engine.imports import full_name
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.plan import plan
from palpate.messages import DeviceState
from palpate.nodes import deformation
from palpate.nodes.base import CompiledNode
from palpate.nodes.base.effect import effects
from palpate.nodes.device.hid import RawHid
from palpate.physics.geometry.graded import landmarks
from palpate.physics.scratch import ScratchFolder
from palpate.views.page.explain import bodies_of, explain_run
from palpate.views.page.feed import mesh_frame
from palpate.views.page.hard import hard_cases
from palpate.views.page.session import choose_bodies, choose_effects
from palpate.views.page.steered import Touched, steer_launch, touched_part
from palpate.web.errors import WebError
from palpate.web.started import Started


@dataclass(frozen=True)
class Place:
    """A scene and an organ that a page offers, with their names for people, and their run.

    figures  error and time of bodies, by `studies.body_figures`
    """

    launch: LaunchFile
    scene: str = ""
    organ: str = ""
    figures: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Variant:
    """One choice of the page's switches.

    place    scene and organ
    body     of the shown organ, by its name for `use:`
    effects  those that the page can switch, and whether they are on
    case     name of the hard case; None: the run as it is
    launch   the run on the simulated clock, whose devices follow the page's pointers
    first    whether the page begins with it, of its scene and organ
    device   whether the run keeps its raw-HID device, whose reports the page exchanges by WebHID
    """

    place: Place
    body: str
    effects: dict[str, bool]
    case: str | None
    launch: LaunchFile
    first: bool
    device: bool = False

    @property
    def choice(self) -> dict[str, Any]:
        """The choice as plain data for the page."""
        return {"scene": self.place.scene, "organ": self.place.organ, "body": self.body, "effects": self.effects,
                "case": self.case, "first": self.first, "device": self.device}  # fmt: skip


def variants(place: Place, folder: Path, wished: Sequence[str] = ()) -> list[Variant]:
    """All variants of a scene and organ, that of the run itself first.

    folder  a private folder
    wished  names of the bodies to offer; (): all that fit the graph

    PageError, GraphError: the graph cannot be steered. WebError: no such body.
    """
    steered, _ = steer_launch(place.launch, folder)
    steered = steered.but(clock="simulated")
    graph = steered.load()
    touched = touched_part(plan(graph))
    known = choose_bodies(graph, touched)
    names = [_body(name, known) for name in wished] or known
    bodies = dict.fromkeys([touched.use, *names])
    compiled = {
        e.name for spec in graph.nodes.values() if issubclass(spec.cls, CompiledNode) for e in effects(spec.cls)
    }
    on = {name: is_on for name, is_on in choose_effects(graph, touched).items() if name in compiled}
    choices = [dict(zip(on, each, strict=True)) for each in itertools.product((True, False), repeat=len(on))]
    found = [
        Variant(place, body, choice, None, steered.but(overrides=_switches(touched, on, body, choice)),
                (body, choice) == (touched.use, on))
        for body in bodies for choice in choices
    ]  # fmt: skip
    usual = [one for one in found if one.effects == on]
    more = [case for one in usual for case in _cases(one)]
    if has_device(place.launch):
        real = place.launch.but(clock="simulated")
        more += [
            replace(
                one, launch=real.but(overrides=_switches(touched, on, one.body, one.effects)), first=False, device=True
            )
            for one in found
        ]
    return sorted(found + more, key=lambda variant: not variant.first)


def has_device(launch: LaunchFile) -> bool:
    """Whether the only device of a run is a raw-HID device, which a page can drive."""
    nodes = launch.load().nodes.values()
    devices = [spec.cls for spec in nodes if DeviceState in spec.streams.values() and spec.off is None]
    return devices == [RawHid]


def _cases(one: Variant) -> list[Variant]:
    """The hard cases of a variant; none if its graph is refused."""
    try:
        planned = plan(one.launch.load())
    except GraphError:
        return []
    return [
        replace(one, case=case.name, launch=one.launch.but(overrides=case.overrides), first=False)
        for case in hard_cases(planned.graph, bodies_of(planned))
    ]


def body_shown(launch: LaunchFile) -> str:
    """The name for `use:` of the body that the page of a run shows. PageError, GraphError: the run cannot be shown."""
    with ScratchFolder("web") as folder:
        return touched_part(steer_launch(launch, Path(folder))[0].plan()).use


def _body(name: str, known: Sequence[str]) -> str:
    """The name for `use:` of a body. WebError: it is no body."""
    shipped = [*known, *(f"deformation.{each}" for each in deformation.__all__)]
    for each in shipped:
        if name in (each, each.rpartition(".")[2]):
            return each
    if "." in name:  # of another distribution
        return name
    names = dict.fromkeys(each.rpartition(".")[2] for each in shipped)
    raise WebError(f"--body: found {name!r}, expected one of {', '.join(names)}, or a full name as in `use:`")


def _switches(touched: Touched, on: dict[str, bool], body: str, effects: dict[str, bool]) -> list[str]:
    """The overrides of a variant: what differs from the run itself."""
    switched = [f"effects.{name}={'on' if wish else 'off'}" for name, wish in effects.items() if wish != on[name]]
    return switched + ([f"{touched.body}.use={body}"] if body != touched.use else [])


def describe_page(
    run: Started, variant: Variant, offered: Sequence[Variant], name: str
) -> tuple[dict[str, Any], bytes]:
    """What the page needs to show a run: the streams of each finger, and the message with the mesh.

    offered  all variants of the folder, to which the switches of the page lead
    """
    touched = touched_part(run.planned)
    shown = touched.bodies
    first = [0]
    for mesh in shown.meshes[:-1]:
        first.append(first[-1] + len(mesh.vertices))
    page = {
        "fingers": [
            {full_name(kind).rpartition(".")[2]: stream for kind, stream in f.items()} for f in touched.fingers
        ],
        "near": touched.near,
        "supports": touched.supports,
        "carried": [
            [begin, begin + len(mesh.vertices), stream]
            for begin, mesh, stream in zip(first, shown.meshes, shown.supports, strict=False)
            if stream
        ],
        "thickness": touched.thickness,
        "bodies": list(shown.streams),
        "first": first,
        "landmarks": [landmarks(mesh.vertices).tolist() for mesh in shown.meshes],
        "loads": dict(shown.loads),
    }
    here = [one for one in offered if one.place == variant.place and one.case is None]
    near = [one.effects for one in here if one.body == variant.body]
    switched = {effect: on for effect, on in variant.effects.items() if variant.effects | {effect: not on} in near}
    bodies = list(dict.fromkeys(one.body for one in here if one.effects == variant.effects))
    about = {"recording": name, "bodies": bodies, "effects": switched, "figures": variant.place.figures or None,
             **_places(variant, offered), **explain_run(run.planned, variant.case)}  # fmt: skip
    cases = {one.case for one in offered if one.place == variant.place and one.body == variant.body}
    about["hard"] = [case for case in about["hard"] if case["name"] in cases]
    return page, mesh_frame(touched, about)


def _places(variant: Variant, offered: Sequence[Variant]) -> dict[str, Any]:
    """Scenes and organs that the page offers, and those of a variant."""
    places = [one.place for one in offered]
    return {"scenes": list(dict.fromkeys(one.scene for one in places)), "scene": variant.place.scene,
            "organs": list(dict.fromkeys(one.organ for one in places)), "organ": variant.place.organ}  # fmt: skip
