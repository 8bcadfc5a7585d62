"""The variants of a page: one run for each body and each choice of effects that its switches offer."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.engine.imports import full_name
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.plan import plan
from palpate.nodes import deformation
from palpate.nodes.base import CompiledNode
from palpate.nodes.base.effect import effects
from palpate.physics.geometry.graded import landmarks
from palpate.views.page.feed import mesh_frame
from palpate.views.page.session import choose_bodies, choose_effects
from palpate.views.page.steered import Touched, steer_launch, touched_part
from palpate.web.errors import WebError
from palpate.web.started import Started


@dataclass(frozen=True)
class Variant:
    """One choice of the page's switches.

    body     of the shown organ, by its name for `use:`
    effects  those that the page can switch, and whether they are on
    launch   the run on the simulated clock, whose devices follow the page's pointers
    first    whether the page begins with it
    """

    body: str
    effects: dict[str, bool]
    launch: LaunchFile
    first: bool


def variants(launch: LaunchFile, folder: Path, wished: Sequence[str] = ()) -> list[Variant]:
    """All variants of a run, that of the run itself first.

    folder  a private folder
    wished  names of the bodies to offer; (): all that fit the graph

    PageError, GraphError: the graph cannot be steered. WebError: no such body.
    """
    steered, _ = steer_launch(launch, folder)
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
        Variant(body, choice, steered.but(overrides=_switches(touched, on, body, choice)),
                (body, choice) == (touched.use, on))
        for body in bodies for choice in choices
    ]  # fmt: skip
    return sorted(found, key=lambda variant: not variant.first)


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
        "thickness": touched.thickness,
        "bodies": list(shown.streams),
        "first": first,
        "landmarks": [landmarks(mesh.vertices).tolist() for mesh in shown.meshes],
        "loads": dict(shown.loads),
    }
    near = [one.effects for one in offered if one.body == variant.body]
    switched = {effect: on for effect, on in variant.effects.items() if variant.effects | {effect: not on} in near}
    bodies = list(dict.fromkeys(one.body for one in offered if one.effects == variant.effects))
    about = {"recording": name, "bodies": bodies, "effects": switched, "left_out": run.left_out}
    return page, mesh_frame(touched, about)
