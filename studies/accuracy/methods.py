"""The methods: which touches each can compute, and at which fidelities."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from palpate.messages import Load, Surface
from palpate.models.fe.meshing.organ import SLAB
from palpate.nodes import deformation
from palpate.nodes.base import Node, inputs, outputs, settings
from palpate.nodes.base.surface import OnSurface
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE, Rigid
from palpate.nodes.deformation.basis_store import shipped
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy import bases, chain, laboratory
from palpate.studies.accuracy.continuum import BED, POISSON, YOUNG
from palpate.studies.accuracy.outcome import Fidelity, Method, Outcome
from palpate.studies.accuracy.touches import Touch
from palpate.studies.accuracy.truth import HERTZ

RATES = (250.0, 500.0, 1000.0, 2000.0, 4000.0)
MESHES = (400, 1000, 3000, 10000)
NODULE = {"nodule_radius": 4e-3, "nodule_depth": 6e-3, "nodule_ratio": 10.0}


def steps() -> list[Fidelity]:
    """The usual steps."""
    return [Fidelity(f"{rate:g} Hz", "step", rate, quick=rate in (500.0, 1000.0)) for rate in RATES]


def meshes(counts: tuple[int, ...] = MESHES) -> list[Fidelity]:
    """Surfaces of growing numbers of vertices."""
    return [Fidelity(f"{n} vertices", "mesh", settings={"surface": {"vertices": n}}, quick=n == 1000) for n in counts]


def _spread(name: str, value: object, text: str) -> Fidelity:
    return Fidelity(text, "reach" if name == "radius" else "form", settings={"spread": {name: value}})


def _of_body(cls: type[Node], own: Callable[[Touch], dict[str, Any]]) -> Callable[[Touch, Fidelity, int], Outcome]:
    def compute(touch: Touch, fidelity: Fidelity, repeats: int) -> Outcome:
        given = dict(fidelity.settings)
        given["body"] = own(touch) | given.get("body", {})
        finger = chain.BALL if touch.finger == "ball" else {}
        return chain.run(touch, cls, replace(fidelity, settings=given), finger, repeats)

    return compute


def _mass_spring(touch: Touch) -> dict[str, Any]:
    """Hertz's law for the ball; its own default damping where the slab is viscous."""
    law: dict[str, Any] = {"stiffness": HERTZ, "exponent": 1.5}
    if touch.retardation == 0.0:
        law["damping"] = 0.0
    return law | (NODULE if touch.nodule else {})


def _beams(touch: Touch) -> dict[str, Any]:
    """One layer as thick as the slab."""
    layer = {"layers": (SLAB,), "moduli": (YOUNG,), "relaxations": (touch.retardation,), "poisson": POISSON}
    return layer | {"radius": 8e-3} | (NODULE if touch.nodule else {})


def _reduced(model: str) -> Callable[[Touch], dict[str, Any]]:
    def own(touch: Touch) -> dict[str, Any]:
        outcome: dict[str, Any] = {"model": model, "young": YOUNG, "poisson": POISSON, "bed": BED,
                                 "retardation": touch.retardation}  # fmt: skip
        if touch.nodule:
            outcome |= {"nodule_centre": (0.0, 0.0, -6e-3), "nodule_radius": 4e-3, "nodule_ratio": 10.0}
        return outcome

    return own


def _reducing(model: str, patient: bool = False, **fixed: object) -> Callable[[Touch, Fidelity, int], Outcome]:
    """With its basis built where none is stored, and with what a stored one says of its error."""

    def compute(touch: Touch, fidelity: Fidelity, repeats: int) -> Outcome:
        own = _reduced(model)(touch) | fixed | fidelity.settings.get("body", {})
        node = ReducedFE(**chain.surface_of(touch), **own)
        offline = bases.ready(node, patient)
        outcome = _of_body(ReducedFE, lambda touch: own)(touch, fidelity, repeats)
        outcome.offline += offline
        errors = [about["error"] for about in shipped().values() if about["key"] == node.key()]
        if model != "linear" and errors and errors[0]:
            outcome.estimated_error = float(errors[0]["mean"])
        return outcome

    return compute


class _Silent(MassSpring):
    """The terminal law alone: nobody asks for the surface."""

    wanted = chain.LAW


class _Hard(Rigid):
    """A plate that nobody looks at."""

    wanted = chain.LAW


def _law(finger: Callable[[Touch], dict[str, Any]]) -> Callable[[Touch, Fidelity, int], Outcome]:
    """contact.Series with one law against a rigid body: the law alone."""

    def compute(touch: Touch, fidelity: Fidelity, repeats: int) -> Outcome:
        hard = replace(fidelity, settings={"body": {"plate_stiffness": 1e12}})
        return chain.run(touch, _Hard, hard, finger(touch), repeats)

    return compute


def _hertz(touch: Touch) -> dict[str, Any]:
    return {"finger_law": "power", "finger_power_stiffness": HERTZ, "finger_power_exponent": 1.5, "finger_damping": 0.0}


def _only_slab(touch: Touch) -> str:
    return "the plate is rigid: there is no body to compute" if touch.body == "plate" else ""


def _no_nodule(touch: Touch) -> str:
    return _only_slab(touch) or ("a law knows of no nodule" if touch.nodule else "")


def _only_ball(touch: Touch) -> str:
    return "" if touch.body == "half-space" else "it holds for a ball on a half-space, with nothing in series"


def _only_fingertip(touch: Touch) -> str:
    return "" if touch.body == "plate" else "it is a fingertip's law, and knows no tissue under it"


def standard(patient: bool = False) -> list[Method]:
    """The methods that come with palpate, and outside solvers that are installed.

    patient  whether a basis that is not stored is built even where that takes minutes
    """
    surfaces = [*steps(), *meshes()]
    reaches = [_spread("radius", r, f"kernel of {1e3 * r:g} mm") for r in (4e-3, 6e-3, 10e-3)]
    forms = [_spread("kernel", k, k) for k in ("wendland", "cosine")]
    net = [
        Fidelity(f"net, {text}", "form", settings={"body": {"coupling": 100.0, "rings": n}})
        for n, text in ((1, "1 ring"), (3, "3 rings"))
    ]
    condensed = [
        Fidelity(f"condensed to {n} vertices", "basis", settings={"body": {"coarse": n}}) for n in (150, 300, 600)
    ]
    sparse = meshes((1000, 3000, 10000))
    all_bodies = {name: getattr(deformation, name.rpartition(".")[2]) for name in deformation.models()}
    others = [(name, body) for name, body in all_bodies.items() if body not in (MassSpring, BeamBundle, ReducedFE)]
    return [
        Method("hertz", "Hertz's law", _law(_hertz), tuple(steps()), _only_ball),
        Method("exponential", "exponential law", _law(lambda t: {"finger_law": "exponential"}), tuple(steps()),
               _only_fingertip),
        Method("hertz-exponential", "Hertz law, stiffening modulus", _law(lambda t: {"finger_law": "hertz"}),
               tuple(steps()), _only_fingertip),
        Method("hunt-crossley", "power law, Hunt-Crossley damping", _law(lambda t: {"finger_law": "power"}),
               tuple(steps()), _only_fingertip),
        Method("series", "laws in series, no surface", _of_body(_Silent, lambda t: _mass_spring(t)),
               tuple(steps()), _no_nodule),
        Method("MassSpring", "MassSpring", _of_body(MassSpring, _mass_spring), (*surfaces, *reaches, *forms, *net),
               _only_slab),
        Method("BeamBundle", "BeamBundle", _of_body(BeamBundle, _beams), (*surfaces, *reaches), _only_slab),
        Method("ReducedFE-linear", "ReducedFE linear", _reducing("linear"),
               (*steps(), *sparse, *condensed, *reaches[:2]), _only_slab),
        Method("ReducedFE", "ReducedFE condensed", _reducing("nonlinear", patient), (*steps(), *sparse, *reaches[:2]),
               _only_slab),
        Method("ReducedFE-sampled", "ReducedFE sampled", _reducing("sampled", patient, modes=20, coarse=150),
               tuple(steps()), _only_slab),
        *(of_user(name, body) for name, body in others),
        *laboratory.methods(),
    ]  # fmt: skip


def chosen(only: Sequence[str] | None, bodies: Mapping[str, type[Node]], patient: bool) -> list[Method]:
    """The standard methods and these bodies of a user's own; or those of them with a name in `only`, and the bodies.

    ArgumentError: there is no such method, or a class is no body.
    """
    methods = [*standard(patient), *(of_user(name, cls) for name, cls in bodies.items())]
    if wrong := [name for name in only or () if name not in {m.name for m in methods}]:
        raise ArgumentError(f"method: found {wrong[0]!r}, expected one of {', '.join(m.name for m in methods)}")
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

    def own(touch: Touch) -> dict[str, Any]:
        material = {"young": YOUNG, "poisson": POISSON, "retardation": touch.retardation}
        return {k: v for k, v in material.items() if k in known}

    points = [*steps(), *(meshes() if issubclass(cls, OnSurface) else ())]
    return Method(name, name, _of_body(cls, own), tuple(points), _only_slab, (_text_of(cls),))


def _text_of(cls: type) -> str:
    """The source of its module, which its answers depend on."""
    try:
        return inspect.getsource(inspect.getmodule(cls) or cls)
    except (OSError, TypeError):
        return cls.__name__
