"""The methods: which touches each can compute, and at which fidelities."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from palpate.messages import Load, Surface
from palpate.nodes import deformation
from palpate.nodes.base import Node, inputs, outputs, settings
from palpate.nodes.base.surface import OnSurface
from palpate.nodes.deformation import Rigid
from palpate.physics.errors import ArgumentError
from palpate.registry import modules, snake
from palpate.studies.accuracy import bodies as slab_bodies
from palpate.studies.accuracy import chain, laboratory
from palpate.studies.accuracy.fidelities import meshes, of_body, only_slab, steps
from palpate.studies.accuracy.outcome import Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.accuracy.truth import HERTZ
from palpate.studies.peers.continuum import POISSON, YOUNG

BALL: dict[str, Any] = {"finger_law": "power", "finger_power_stiffness": HERTZ, "finger_power_exponent": 1.5,
                        "finger_damping": 0.0}  # fmt: skip
"""Hertz's law of a ball on a half-space."""


class _Hard(Rigid):
    """A plate that nobody looks at."""

    wanted = chain.LAW


def _law(contact: dict[str, Any]) -> Callable[[BenchCase, Fidelity, int], MethodOutcome]:
    """contact.Series with these settings against a rigid body: the law alone."""

    def compute(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
        hard = replace(fidelity, settings={"body": {"plate_stiffness": 1e12}})
        return chain.run(touch, _Hard, hard, contact, repeats)

    return compute


def _only_ball(touch: BenchCase) -> str:
    return "" if touch.body == "half-space" else "it holds for a ball on a half-space, with nothing in series"


def _only_fingertip(touch: BenchCase) -> str:
    return "" if touch.body == "plate" else "it is a fingertip's law, and knows no tissue under it"


def standard() -> list[Method]:
    """The methods that come with palpate, and outside solvers that are installed."""
    laws = (
        ("exponential", "exponential", "exponential law"),
        ("hertz-exponential", "hertz", "Hertz law, stiffening modulus"),
        ("hunt-crossley", "power", "power law, Hunt-Crossley damping"),
    )
    known = modules(slab_bodies)
    own, others = [], []
    for name, body in reversed(deformation.bodies().items()):
        if adapter := known.get(snake(body.__name__)) if body.__module__.startswith(deformation.__name__) else None:
            own += adapter.methods()
        else:
            others.append(of_user(name, body))
    return [
        Method("hertz", "Hertz's law", _law(BALL), tuple(steps()), _only_ball, law=True),
        *(Method(name, title, _law({"finger_law": law}), tuple(steps()), _only_fingertip, law=True)
          for name, law, title in laws),
        *own, *others, *laboratory.methods(),
    ]  # fmt: skip


def chosen(only: Sequence[str] | None, bodies: Mapping[str, type[Node]]) -> list[Method]:
    """The standard methods and these bodies of a user's own; or those of them with a name in `only`, and the bodies.

    ArgumentError: there is no such method, or a class is no body.
    """
    methods = [*standard(), *(of_user(name, cls) for name, cls in bodies.items())]
    if wrong := [name for name in only or () if name not in {m.name for m in methods}]:
        names = ", ".join(m.name for m in methods)
        raise ArgumentError("; ".join([f"method: found {wrong[0]!r}, expected one of {names}", *laboratory.missing()]))
    return [m for m in methods if not only or m.name in only or m.name in bodies]


def of_user(name: str, cls: type[Node]) -> Method:
    """A body of one's own, by its class: with the slab's material in those of its settings that are called like it.

    ArgumentError: it is no deformable body.
    """
    if Surface not in outputs(cls) or Load not in {port.type for port in inputs(cls)}:
        raise ArgumentError(
            f"body {name!r}: found {cls.__name__}, expected a body: a node that takes Load and sends Surface"
        )
    known = settings(cls)

    def own(touch: BenchCase) -> dict[str, Any]:
        material = {"young": YOUNG, "poisson": POISSON, "retardation": touch.retardation}
        return {k: v for k, v in material.items() if k in known}

    points = [*steps(), *(meshes() if issubclass(cls, OnSurface) else ())]
    return Method(name, name, of_body(cls, own), tuple(points), only_slab, source=(_text_of(cls),))


def _text_of(cls: type) -> str:
    """The source of its module, which its answers depend on."""
    try:
        return inspect.getsource(inspect.getmodule(cls) or cls)
    except (OSError, TypeError):
        return cls.__name__
