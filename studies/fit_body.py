"""Constants of a calibrated tissue model, fitted to a reference body under the scene's own patch, and what is left.

MassSpring's law is that of a ball by default; under a patch of fixed width the force has another shape. The graph's
touch is recorded once, the reference computes it, and of its indentation s and force f at all instants of contact

    MassSpring   f = K s^n (1 + c s')    K, n, c by least squares of f: for each n a linear problem in K and K c >= 0
    BeamBundle   all moduli times a and all relaxation times times b, by least squares of s under the reference's own
                 loads. Below the strain limit s is linear in 1/a, so for each b the best a is known in closed form

What the touch is off by with the constants is then measured, before and after: no constant makes the surface of springs
that of a solid.
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import Contact, Load, Surface
from palpate.nodes.deformation import BeamBundle, MassSpring
from palpate.physics.bodies import beam_foundation
from palpate.physics.errors import ArgumentError
from palpate.physics.materials.voigt import STRAIN_LIMIT
from palpate.records.changed import changed
from palpate.records.compare import compare
from palpate.records.player import Player
from palpate.studies.known import body_of, own_error
from palpate.studies.search import Show, off_by, touched, write

QUANTITIES = ("force", "indentation", "shape")
LEAST = 20  # Instants of contact below which nothing is fitted
SLOWER = (1e-4, 1e2)  # Factors of the relaxation times that are tried
Pressed = tuple[np.ndarray, np.ndarray, tuple[float, float, float], tuple[float, float, float]]
"""Nodes (k) and forces [N] (k,3) of a load, foot [m] (3) and outward normal [1] (3)."""
THICK = 1e6
"""Factor of the thickness of beams that are to stay below their strain limit; moduli times it keep their compliance."""


@dataclass(frozen=True)
class FittedBody:
    """The constants as `--set` takes them; what the touch is off by [1], rms over the peak of the reference, and the
    force at worst, by quantity, before and after; what is known of the reference's own error, and a caution."""

    overrides: dict[str, Any]
    before: dict[str, float]
    after: dict[str, float]
    reference: str
    caution: str = ""


def fit_body(
    launch: LaunchFile, file: Path, reference: Sequence[str] = (), show: Show = lambda what: None
) -> FittedBody:
    """Fit the graph's body to a reference, by default ReducedFE in its place, and write the launch file.

    reference  overrides that make it

    ArgumentError: a body without constants to fit, a touch without contact.
    """
    graph = launch.load()
    name = body_of(graph)
    cls = graph.nodes[name].cls
    if cls not in (MassSpring, BeamBundle):
        raise ArgumentError(
            f"{graph.path}: node {name!r} is {cls.__name__}, expected one with a constant to calibrate: "
            "deformation.MassSpring or deformation.BeamBundle"
        )
    base = list(reference) or [f"{name}.use=deformation.ReducedFE"]
    with tempfile.TemporaryDirectory() as folder:
        recording = touched(launch, Path(folder) / "touch.mcap")
        show("the touch")
        senders = [sender for sender, spec in graph.nodes.items() if Contact in spec.streams.values()]
        loaders = [edge.producer for edge in graph.nodes[name].edges]
        pressed: list[tuple[float, ...]] = []
        borne: list[tuple[list[Pressed], list[float]]] = []

        def on_tick(players: Sequence[Player]) -> None:
            for sent in (message for sender in senders for message in players[0].last(sender)):
                if isinstance(sent, Contact) and sent.force > 0.0 and sent.indentation > 0.0:
                    pressed.append((sent.indentation, sent.indentation_rate, sent.force))
            if cls is BeamBundle:
                borne.append(_borne(players[0], loaders, name))

        _, first = compare(recording, [[]], reference=base, on_tick=on_tick)
        show("the reference and the model as it is")
        if len(pressed) < LEAST:
            raise ArgumentError(f"{graph.path}: the touch hardly presses the body; a longer one may: --duration '3 s'")
        caution = ""
        if cls is MassSpring:
            law: dict[str, Any] = power_law(*np.array(pressed).T)
        else:
            spec = graph.nodes[name]
            law, caution = layer_constants(BeamBundle(**spec.settings), borne, spec.every / graph.rate)
        fitted = {f"{name}.{key}": value for key, value in law.items()}
        _, last = compare(recording, [[f"{key}={value}" for key, value in fitted.items()]], reference=base)
        show("the fitted model")
        known = own_error(changed(recording, base).graph)
    before, after = (
        {q: off_by(one, q) for q in QUANTITIES} | {"worst": off_by(one, "force", "peak")} for one in (first, last)
    )
    told = (
        f"Fitted by palpate fit body to {' '.join(base)} on this graph's touch. Differences, RMS of its peak:",
        f"  before: {words(before)}",
        f"  after:  {words(after)}",
        *filter(None, (known, caution)),
    )
    write(launch, fitted, told, file)
    return FittedBody(fitted, before, after, known, caution)


def words(off: dict[str, float]) -> str:
    """The differences by quantity."""
    shares = ", ".join(f"{name} {100 * off[name]:.2g} %" for name in QUANTITIES)
    return f"{shares}; force {100 * off['worst']:.2g} % at worst"


def power_law(depth: np.ndarray, rate: np.ndarray, force: np.ndarray) -> dict[str, Any]:
    """K [N/m^n], n in [1, 3] and c >= 0 [s/m] of f = K s^n (1 + c s') through s [m], s' [m/s] and f [N] (T,)."""
    deepest = float(depth.max())

    def solved(n: float) -> tuple[np.ndarray, float]:
        elastic = (depth / deepest) ** n
        return optimize.nnls(np.stack([elastic, elastic * rate], axis=1), force)

    n = float(optimize.minimize_scalar(lambda n: solved(n)[1], bounds=(1.0, 3.0), method="bounded").x)
    (k, kc), _ = solved(n)
    if not k > 0.0:
        raise ArgumentError("no power law fits the reference's force: it does not rise with its indentation")
    rounded = {"stiffness": k / deepest**n, "exponent": n, "damping": kc / k}
    return {name: float(f"{value:.6g}") for name, value in rounded.items()}


def _borne(player: Player, loaders: Sequence[str], body: str) -> tuple[list[Pressed], list[float]]:
    """Loads of one tick on a body, and the indentation [m] under each after its step."""
    loads = [m for sender in loaders for m in player.last(sender) if isinstance(m, Load)]
    surface = next((m for m in player.last(body) if isinstance(m, Surface)), None)
    if surface is None or surface.tick != loads[0].tick:
        return [], []
    depths = surface.laws[:, 4].tolist() if len(loads) > 1 else [surface.previous_indentation]
    return [(load.nodes.copy(), load.forces.copy(), load.foot, load.normal) for load in loads], depths


def _depths(bed: beam_foundation.BeamFoundation, loads: list[Pressed], dt: float) -> np.ndarray:
    """Indentations [m] of a bed under these loads after a step."""
    for contact, (nodes, forces, foot, normal) in enumerate(loads):
        beam_foundation.bear(bed, contact, nodes, forces, foot, normal)
    beam_foundation.answer(bed, dt)
    return bed.contacts.laws[:, 4].copy()


def layer_constants(
    body: BeamBundle, borne: Sequence[tuple[list[Pressed], list[float]]], dt: float
) -> tuple[dict[str, Any], str]:
    """Moduli and relaxation times with which the beams have the indentations [m] of a reference under its loads, one
    entry for each step of dt [s]; and a caution where the loads would take beams of this thickness to their limit."""
    steps = [(loads, depths) for loads, depths in borne if loads]
    right = np.concatenate([depths for _, depths in steps])

    def solved(logarithm: float) -> tuple[float, float]:
        """Squared error and the factor 1/a, for the logarithm of b."""
        bed = body.foundation(THICK, math.exp(logarithm), len(steps[0][0]))
        own = np.concatenate([_depths(bed, loads, dt) for loads, _ in steps])
        softer = float(own @ right / (own @ own))
        return float(np.sum((softer * own - right) ** 2)), softer

    at = 0.0
    if any(body.relaxations):
        within = np.log(SLOWER)
        at = float(optimize.minimize_scalar(lambda x: solved(x)[0], bounds=within, options={"xatol": 0.05}).x)
    stiffer = 1.0 / solved(at)[1]
    moduli = [float(f"{modulus * stiffer:.4g}") for modulus in body.moduli]
    relaxations = [float(f"{time * math.exp(at):.4g}") for time in body.relaxations]
    areas = body.mesh().areas
    pressure = max((float((-f @ np.array(n) / areas[k]).max()) for loads, _ in steps for k, f, _, n in loads if len(k)))
    thicker = pressure / min(moduli) / STRAIN_LIMIT
    caution = ""
    if thicker > 1.0:
        layers = ", ".join(f"{1e3 * layer * math.ceil(2 * thicker):g} mm" for layer in body.layers)
        caution = (
            f"The deepest press takes these beams to their strain limit of {STRAIN_LIMIT:g}, where they are too stiff; "
            f"thicker ones would not be. Give the scene `tissue: {{layers: [{layers}]}}` and fit again"
        )
    return {"moduli": moduli, "relaxations": relaxations}, caution
