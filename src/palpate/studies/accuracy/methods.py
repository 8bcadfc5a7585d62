"""The methods of the benchmark, with the test cases that each supports and its fidelities."""

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
from palpate.studies.accuracy import chain, reference_solvers
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.fidelities import MESHES, STEPS, of_body, only_slab
from palpate.studies.accuracy.outcome import Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.reference import HERTZ
from palpate.studies.peers.continuum import POISSON, YOUNG

BALL: dict[str, Any] = {"finger_law": "power", "finger_power_stiffness": HERTZ, "finger_power_exponent": 1.5,
                        "finger_damping": 0.0}  # fmt: skip
"""Hertz's law of a ball on a half-space."""


class _RigidLaw(Rigid):
    """Computes the terminal law, not the surface."""

    wanted = chain.LAW


def _law(contact: dict[str, Any]) -> Callable[[BenchCase, Fidelity, int], MethodOutcome]:
    """contact.Series with these settings on a rigid body: the contact law alone."""

    def compute(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
        hard = replace(fidelity, settings={"body": {"plate_stiffness": 1e12}})
        return chain.run(touch, _RigidLaw, hard, contact, repeats)

    return compute


def _only_ball(touch: BenchCase) -> str:
    return "" if touch.body == "half-space" else "it is valid for a ball on a half-space, without a finger in series"


def _only_fingertip(touch: BenchCase) -> str:
    return "" if touch.body == "plate" else "it is the law of a fingertip and has no tissue"


def standard() -> list[Method]:
    """The shipped methods and the reference solvers that are installed."""
    laws = (
        ("exponential", "exponential", "exponential law"),
        ("hertz-exponential", "hertz", "Hertz law, stiffening modulus"),
        ("hunt-crossley", "power", "power law, Hunt-Crossley damping"),
    )
    known = modules(slab_bodies)
    adapted, others = [], []
    for name, body in reversed(deformation.bodies().items()):
        if adapter := known.get(snake(body.__name__)) if body.__module__.startswith(deformation.__name__) else None:
            adapted += adapter.methods()
        else:
            others.append(of_user(name, body))
    return [
        Method("hertz", "Hertz's law", _law(BALL), STEPS, _only_ball, law=True),
        *(Method(name, title, _law({"finger_law": law}), STEPS, _only_fingertip, law=True)
          for name, law, title in laws),
        *adapted, *others, *reference_solvers.methods(),
    ]  # fmt: skip


def choose_methods(only: Sequence[str] | None, bodies: Mapping[str, type[Node]]) -> list[Method]:
    """The standard methods, or those named in `only`, and these custom bodies.

    ArgumentError: an unknown method, or a class that is not a deformable body.
    """
    methods = [*standard(), *(of_user(name, cls) for name, cls in bodies.items())]
    if wrong := [name for name in only or () if name not in {m.name for m in methods}]:
        names = ", ".join(m.name for m in methods)
        raise ArgumentError(
            "; ".join([f"method: found {wrong[0]!r}, expected one of {names}", *reference_solvers.missing()])
        )
    return [m for m in methods if not only or m.name in only or m.name in bodies]


def of_user(name: str, cls: type[Node]) -> Method:
    """A custom body by its class, with the material of the slab in the settings of the same name.

    ArgumentError: the class is not a deformable body.
    """
    if Surface not in outputs(cls) or Load not in {port.type for port in inputs(cls)}:
        raise ArgumentError(
            f"body {name!r}: found {cls.__name__}, expected a body: a node that takes Load and sends Surface"
        )
    known = settings(cls)

    def slab(touch: BenchCase) -> dict[str, Any]:
        material = {"young": YOUNG, "poisson": POISSON, "retardation": touch.retardation}
        return {k: v for k, v in material.items() if k in known}

    points = (*STEPS, *(MESHES if issubclass(cls, OnSurface) else ()))
    return Method(name, name, of_body(cls, slab), points, only_slab, source=(_text_of(cls),))


def _text_of(cls: type) -> str:
    """Source code of the module of a class, for the key of cached results."""
    try:
        return inspect.getsource(inspect.getmodule(cls) or cls)
    except (OSError, TypeError):
        return cls.__name__
