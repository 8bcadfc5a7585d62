"""Fit the constants of a calibrated tissue model to a reference body under the contact patch of the scene.

By default MassSpring has the force law of a ball; under a patch of fixed width the law differs. The touch of the graph
is recorded once and computed again by the reference. Its indentation s and force f during contact determine

    MassSpring   f = K <s + tau s'>^n (1 + c s')    K, n, c, tau by least squares of f: for each n and tau a linear
                 problem in K and K c >= 0; with a stiffness map, f over its factor under the finger
    BeamBundle   all moduli times a and all relaxation times times b, by least squares of s under the loads of the
                 reference. Below the strain limit s is linear in 1/a, so the best a for each b has a closed form

The remaining error is then measured with the old and the new constants. Springs do not deform their surface as a solid
does, with any constants.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import Contact, Load, Surface
from palpate.nodes.deformation import BeamBundle, MassSpring
from palpate.physics.bodies import beam_foundation
from palpate.physics.errors import ArgumentError
from palpate.physics.materials.voigt import STRAIN_LIMIT
from palpate.physics.scratch import ScratchFolder
from palpate.records.changed import change_plan
from palpate.records.compare import Variant, compare
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.studies.model_error import body_of, error_sentence
from palpate.studies.search import Show, record_touch, relative_error, write

QUANTITIES = ("force", "indentation", "shape")
LEAST = 20  # Fewest samples in contact for a fit
MOST_RETARDATION = 0.2  # [s]
NEGLIGIBLE = 1e-3  # [1] Decrease of the residual below which a retardation is not fitted
SLOWER = (1e-4, 1e2)  # Range of the factor of the relaxation times
PatchLoad = tuple[np.ndarray, np.ndarray, tuple[float, float, float], tuple[float, float, float]]
"""Nodes (k) and forces [N] (k,3) of a load, foot [m] (3) and outward normal [1] (3)."""
THICK = 1e6
"""Factor of thickness and moduli that keeps beams below their strain limit without a change of their compliance."""


@dataclass(frozen=True)
class FittedBody:
    """Fitted constants and the remaining error.

    overrides      constants as `--set` takes them
    before, after  [1] RMS error of each of `QUANTITIES` and peak error of the force (`worst`), over the reference peak
    reference      a sentence on the known error of the reference
    caution        a warning, or ""
    """

    overrides: dict[str, Any]
    before: dict[str, float]
    after: dict[str, float]
    reference: str
    caution: str = ""


def fit_body(
    launch: LaunchFile, file: Path, reference: Sequence[str] = (), show: Show = lambda what: None
) -> FittedBody:
    """Fit the body of the graph to a reference and write the launch file.

    reference  overrides that make the reference; by default they replace the body by ReducedFE

    ArgumentError: the body has no constants to fit, or the touch has no contact.
    """
    graph = launch.load()
    name = body_of(graph)
    cls = graph.nodes[name].cls
    if cls not in (MassSpring, BeamBundle):
        raise ArgumentError(
            f"{graph.path}: node {name!r} is {cls.__name__}, expected one with a constant to calibrate: "
            "deformation.MassSpring or deformation.BeamBundle"
        )
    spec = graph.nodes[name]
    base = list(reference) or [f"{name}.use=deformation.ReducedFE"]
    with ScratchFolder("fit-body") as folder:
        recording = record_touch(launch, Path(folder) / "touch.mcap")
        show("the touch")
        pressed, feet, steps, first = _press_reference(recording, graph, name, base)
        show("the reference and the model as it is")
        if len(pressed) < LEAST:
            raise ArgumentError(
                f"{graph.path}: found {len(pressed)} samples in contact, expected at least {LEAST}; try a longer "
                "touch: --duration '3 s'"
            )
        # Fit the constants, then compute the touch with them.
        caution = ""
        if cls is MassSpring:
            relative = MassSpring(**spec.settings).relative_stiffness(feet)
            depth, rate, force = np.array(pressed).T
            law: dict[str, Any] = power_law(depth, rate, force, relative)
        else:
            law, caution = layer_constants(BeamBundle(**spec.settings), steps, spec.every / graph.rate)
        fitted = {f"{name}.{key}": value for key, value in law.items()}
        _, last = compare(recording, [[f"{key}={value}" for key, value in fitted.items()]], reference=base)
        show("the fitted model")
        known = error_sentence(change_plan(recording, base).graph)
    before, after = (
        {q: relative_error(one, q) for q in QUANTITIES} | {"worst": relative_error(one, "force", "peak")}
        for one in (first, last)
    )
    caution = " ".join(filter(None, (caution, no_better(before["force"], after["force"]))))
    comments = (
        f"Fitted by palpate fit body to {' '.join(base)} on this graph's touch. Differences, RMS of its peak:",
        f"  before: {words(before)}",
        f"  after:  {words(after)}",
        *filter(None, (known, caution)),
    )
    write(launch, fitted, comments, file)
    return FittedBody(fitted, before, after, known, caution)


Steps = list[tuple[list[PatchLoad], list[float]]]


def _press_reference(
    recording: Recording, graph: Graph, name: str, base: Sequence[str]
) -> tuple[list[tuple[float, float, float]], list[tuple[float, float, float]], Steps, Variant]:
    """Compute the touch with the reference. Of each tick in contact: indentation [m], its rate [m/s] and force [N], and
    the foot [m]; of each tick of beams: loads and indentations; and the differences of the model as it is."""
    senders = [sender for sender, spec in graph.nodes.items() if Contact in spec.streams.values()]
    loaders = [edge.producer for edge in graph.nodes[name].edges]
    pressed: list[tuple[float, float, float]] = []
    feet: list[tuple[float, float, float]] = []
    steps: Steps = []

    def on_tick(players: Sequence[Player]) -> None:
        for sent in (message for sender in senders for message in players[0].last(sender)):
            if isinstance(sent, Contact) and sent.force > 0.0 and sent.indentation > 0.0:
                pressed.append((sent.indentation, sent.indentation_rate, sent.force))
                feet.append(sent.foot)
        if graph.nodes[name].cls is BeamBundle:
            steps.append(_loads_and_depths(players[0], loaders, name))

    _, first = compare(recording, [[]], reference=base, on_tick=on_tick)
    return pressed, feet, steps, first


def no_better(before: float, after: float) -> str:
    """A warning if the force [1] differs no less after the fit than before, else "". The fit reads the touch of the
    reference; the touch is then computed with the fitted body, which moves the finger in another way."""
    if after < before:
        return ""
    return (
        f"the force differs by {100.0 * after:.2g} % with the fitted constants and {100.0 * before:.2g} % with those "
        "of the graph: keep the old ones for this touch"
    )


def words(errors: dict[str, float]) -> str:
    """Errors of all quantities as text."""
    shares = ", ".join(f"{name} {100 * errors[name]:.2g} %" for name in QUANTITIES)
    return f"{shares}; force {100 * errors['worst']:.2g} % at worst"


def power_law(
    depth: np.ndarray, rate: np.ndarray, force: np.ndarray, relative: np.ndarray | float = 1.0
) -> dict[str, Any]:
    """K [N/m^n], n in [1, 3], c >= 0 [s/m] and tau in [0, `MOST_RETARDATION`] [s] of
    f = K q^(2n - 1) <s + tau s'>^n (1 + c s') through s [m], s' [m/s] and f [N] (T,).

    relative  q [1] (T,) of the stiffness map of MassSpring under each sample
    """
    deepest = float(depth.max())

    def solve_weights(n: float, tau: float) -> tuple[np.ndarray, float]:
        elastic = relative ** (2.0 * n - 1.0) * np.maximum((depth + tau * rate) / deepest, 0.0) ** n
        return optimize.nnls(np.stack([elastic, elastic * rate], axis=1), force)

    def exponent(tau: float) -> float:
        return float(
            optimize.minimize_scalar(lambda n: solve_weights(n, tau)[1], bounds=(1.0, 3.0), method="bounded").x
        )

    def residual(tau: float) -> float:
        return solve_weights(exponent(tau), tau)[1]

    best = optimize.minimize_scalar(residual, bounds=(0.0, MOST_RETARDATION), method="bounded", options={"xatol": 1e-6})
    tau = float(best.x) if best.fun < (1.0 - NEGLIGIBLE) * residual(0.0) else 0.0
    n = exponent(tau)
    (k, kc), _ = solve_weights(n, tau)
    if not k > 0.0:
        raise ArgumentError("no power law fits: the force of the reference does not rise with its indentation")
    rounded = {"stiffness": k / deepest**n, "exponent": n, "damping": kc / k, "retardation": tau}
    return {name: float(f"{value:.6g}") for name, value in rounded.items()}


def _loads_and_depths(player: Player, loaders: Sequence[str], body: str) -> tuple[list[PatchLoad], list[float]]:
    """Loads on a body in one tick, and the indentation [m] under each after the step; empty without a step."""
    loads = [m for sender in loaders for m in player.last(sender) if isinstance(m, Load)]
    surface = next((m for m in player.last(body) if isinstance(m, Surface)), None)
    if surface is None or surface.tick != loads[0].tick:
        return [], []
    depths = surface.laws[:, 4].tolist() if len(loads) > 1 else [surface.previous_indentation]
    return [(load.nodes.copy(), load.forces.copy(), load.foot, load.normal) for load in loads], depths


def _depths(foundation: beam_foundation.BeamFoundation, loads: list[PatchLoad], dt: float) -> np.ndarray:
    """Indentations [m] of a beam foundation under these loads after one step."""
    for contact, (nodes, forces, foot, normal) in enumerate(loads):
        beam_foundation.bear(foundation, contact, nodes, forces, foot, normal)
    beam_foundation.answer(foundation, dt)
    return foundation.contacts.laws[:, 4].copy()


def layer_constants(
    body: BeamBundle, steps: Sequence[tuple[list[PatchLoad], list[float]]], dt: float
) -> tuple[dict[str, Any], str]:
    """Moduli and relaxation times of beams that match the indentations [m] of a reference under its loads.

    steps  loads and indentations of each step of dt [s]

    Returns a warning too, if the loads would take beams of this thickness to their strain limit; else "".
    """
    steps = [(loads, depths) for loads, depths in steps if loads]
    target = np.concatenate([depths for _, depths in steps])

    def solve_weights(log_b: float) -> tuple[float, float]:
        """Squared error and the factor 1/a, for log b."""
        foundation = body.foundation(THICK, math.exp(log_b), len(steps[0][0]))
        depths = np.concatenate([_depths(foundation, loads, dt) for loads, _ in steps])
        softer = float(depths @ target / (depths @ depths))
        return float(np.sum((softer * depths - target) ** 2)), softer

    log_b = 0.0
    if any(body.relaxations):
        within = np.log(SLOWER)
        log_b = float(optimize.minimize_scalar(lambda x: solve_weights(x)[0], bounds=within, options={"xatol": 0.05}).x)
    stiffer = 1.0 / solve_weights(log_b)[1]
    moduli = [float(f"{modulus * stiffer:.4g}") for modulus in body.moduli]
    relaxations = [float(f"{time * math.exp(log_b):.4g}") for time in body.relaxations]
    areas = body.mesh().areas
    pressure = max((float((-f @ np.array(n) / areas[k]).max()) for loads, _ in steps for k, f, _, n in loads if len(k)))
    thicker = pressure / min(moduli) / STRAIN_LIMIT
    caution = ""
    if thicker > 1.0:
        layers = ", ".join(f"{1e3 * layer * math.ceil(2 * thicker):g} mm" for layer in body.layers)
        caution = (
            f"The deepest press takes these beams to their strain limit of {STRAIN_LIMIT:g}, where they are too stiff. "
            f"Set thicker layers in the scene, `tissue: {{layers: [{layers}]}}`, and fit again"
        )
    return {"moduli": moduli, "relaxations": relaxations}, caution
